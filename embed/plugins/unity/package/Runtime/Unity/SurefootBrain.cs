using System;
using System.Collections.Generic;
using UnityEngine;

namespace Surefoot.Unity
{
    /// <summary>
    /// Decides for all agents with the same body, six times a second, with one batch of rays. A scene without one gets one when the first agent
    /// is enabled; place one yourself to choose a graph, layers or another body.
    /// </summary>
    [DefaultExecutionOrder(-100)]
    [AddComponentMenu("Surefoot/Surefoot Brain")]
    public sealed class SurefootBrain : MonoBehaviour
    {
        [SerializeField, Tooltip("Proved graph of the level; without one, agents head straight for their goals")] private SurefootGraphAsset graph;
        [SerializeField, Tooltip("The level that the graph was proved on, as a .sfmap.bytes file; without one, agents rehearse nothing")]
        private TextAsset level;
        [SerializeField] private SurfaceLayers surfaces = new SurfaceLayers();
        [SerializeField] private BodySettings body = new BodySettings();
        [SerializeField, Tooltip("general-reactive, general-lstm, or a folder of a model")] private string policy = "general-reactive";
        [SerializeField, Range(1, 4096)] private int maxAgents = 64;
        [SerializeField, Tooltip("Share of the policy's exploration noise"), Range(0, 1)] private float noise = Agents.DefaultNoise;

        private readonly List<SurefootAgent> members = new List<SurefootAgent>();
        private readonly Stack<uint> freeNumbers = new Stack<uint>();
        private SurefootAgent[] deciding;
        private uint[] ids;
        private CharacterState[] states;
        private SightRay[] rays;
        private SightHit[] hits;
        private AgentAction[] actions;
        private RayBatch rayBatch;
        private float secondsLeft;
        private int knownDeviceChanges = -1;

        internal Agents Agents { get; private set; }

        internal Rehearsals Rehearsals { get; private set; }

        internal BodySettings BodySettings => body;

        internal Graph Graph => graph == null ? null : graph.Graph;

        internal UnityFrame Frame => graph == null ? default(UnityFrame) : graph.Frame;

        /// <summary>The brain of the scene; it is made if there is none.</summary>
        internal static SurefootBrain OfScene()
        {
            SurefootBrain found = FindFirstObjectByType<SurefootBrain>();
            return found != null ? found : new GameObject("Surefoot Brain").AddComponent<SurefootBrain>();
        }

        /// <summary>
        /// Replaces the blocks that rehearsals know, at most 1024: upright crates, barricades and closed doors. Call it when a box has come to
        /// rest, or is gone. Agents then take another plan, and avoid legs on which a block stops their rehearsals.
        /// </summary>
        public void SetBlocks(IReadOnlyList<BoxCollider> boxes)
        {
            Prepare();
            if (Rehearsals == null)
            {
                throw new SurefootException(Status.BadState, $"{name} has no rehearsals, which blocks are for: set its Graph and its Level");
            }
            Block[] blocks = new Block[boxes.Count];
            for (int idx = 0; idx < blocks.Length; idx++)
            {
                blocks[idx] = BlockOf(boxes[idx]);
            }
            Rehearsals.SetBlocks(blocks);
        }

        private Block BlockOf(BoxCollider box)
        {
            Transform place = box.transform;
            Vector3 size = Vector3.Scale(box.size, place.lossyScale);
            Vector3 foot = place.TransformPoint(box.center) + Vector3.down * (Mathf.Abs(size.y) / 2);
            return new Block
            {
                Foot = Frame.ToMap(foot.ToVec3()),
                Width = Mathf.Abs(size.x),
                Depth = Mathf.Abs(size.z),
                Height = Mathf.Abs(size.y),
                Yaw = UnityFrame.Yaw(place.eulerAngles.y),
            };
        }

        /// <summary>Takes an agent in, and returns its number.</summary>
        internal uint Join(SurefootAgent agent)
        {
            Prepare();
            if (freeNumbers.Count == 0)
            {
                throw new SurefootException(Status.InvalidArgument, $"{name} has room for {maxAgents} agents: raise its Max Agents");
            }
            members.Add(agent);
            return freeNumbers.Pop();
        }

        internal void Leave(SurefootAgent agent, uint number)
        {
            if (members.Remove(agent))
            {
                freeNumbers.Push(number);
            }
        }

        /// <summary>Casts rays at the layers of the level.</summary>
        internal void CastRays(ReadOnlySpan<SightRay> cast, Span<SightHit> found) =>
            rayBatch.Cast(cast, found, Frame, surfaces);

        /// <summary>Makes what decisions need, once: agents may be enabled before the brain wakes.</summary>
        private void Prepare()
        {
            if (Agents != null)
            {
                return;
            }
            using (Policy weights = IsFolder(policy) ? Policy.Load(policy) : Policy.Shipped(policy))
            {
                Agents = new Agents(weights, (uint)maxAgents, body.ToBody());
                if (level != null && graph != null)
                {
                    using (Map map = Map.Load(level.bytes))
                    {
                        Rehearsals = new Rehearsals(weights, map, body.ToBody());
                    }
                }
            }
            deciding = new SurefootAgent[maxAgents];
            ids = new uint[maxAgents];
            states = new CharacterState[maxAgents];
            actions = new AgentAction[maxAgents];
            rays = new SightRay[maxAgents * Agents.RayCount];
            hits = new SightHit[rays.Length];
            rayBatch = new RayBatch(rays.Length);
            for (int number = maxAgents - 1; number >= 0; number--)
            {
                freeNumbers.Push((uint)number);
            }
        }

        private static bool IsFolder(string policy) => policy.IndexOf('/') >= 0 || policy.IndexOf('\\') >= 0;

        private void FixedUpdate()
        {
            secondsLeft -= Time.fixedDeltaTime;
            if (secondsLeft > 0 || Agents == null)
            {
                return;
            }
            // Decisions keep their rate on average, whatever the fixed step; a step longer than a decision has one.
            secondsLeft = Mathf.Max(secondsLeft + Agents.DecisionSeconds, 0);
            SenseDevices();
            Decide(Gather());
            ReportEnds();
        }

        private void SenseDevices()
        {
            if (knownDeviceChanges != SurefootDevice.Changes)
            {
                knownDeviceChanges = SurefootDevice.Changes;
                Agents.SetDevices(SurefootDevice.All(Frame));
            }
        }

        /// <summary>Collects the agents that go on, and returns their number.</summary>
        private int Gather()
        {
            int count = 0;
            foreach (SurefootAgent member in members)
            {
                if (member.BeginDecision(out states[count]))
                {
                    ids[count] = member.Number;
                    deciding[count] = member;
                    count++;
                }
            }
            return count;
        }

        private void Decide(int count)
        {
            if (count == 0)
            {
                return;
            }
            ReadOnlySpan<uint> numbers = ids.AsSpan(0, count);
            Span<CharacterState> seen = states.AsSpan(0, count);
            Span<SightRay> cast = rays.AsSpan(0, count * Agents.RayCount);
            Span<SightHit> found = hits.AsSpan(0, cast.Length);
            Agents.Rays(seen, cast);
            CastRays(cast, found);
            Agents.Observe(numbers, seen, found);
            Agents.Decide(numbers, actions.AsSpan(0, count), noise);
            for (int idx = 0; idx < count; idx++)
            {
                deciding[idx].Act(actions[idx]);
            }
        }

        private void ReportEnds()
        {
            // A listener may disable agents, which shortens the list.
            for (int idx = members.Count - 1; idx >= 0; idx = Mathf.Min(idx, members.Count) - 1)
            {
                members[idx].ReportEnd();
            }
        }

        private void OnDestroy()
        {
            rayBatch?.Dispose();
            Rehearsals?.Dispose();
            Agents?.Dispose();
        }
    }
}
