using System;
using System.Linq;

namespace Surefoot.Tests
{
    internal static class ErrorTests
    {
        internal static void NameWhatToChange(Files files)
        {
            Expect.Fails(Status.NotFound, "use general-reactive or general-lstm", () => Policy.Shipped("general"));
            Expect.Fails(Status.NotFound, "no such folder", () => Policy.Load("no such folder"));
            Expect.Fails(Status.BadFile, "manifest", () => Policy.Load(new byte[] { 1 }, new byte[] { 2 }));
            Expect.Fails(Status.NotFound, "no such file", () => Graph.Load("no such file"));
            Expect.Fails(Status.InvalidArgument, "path is null", () => Graph.Load((string)null));
            Expect.Fails(Status.BadFile, "", () => Graph.Load(new[] { (byte)'{' }));
            Expect.Fails(Status.BadFile, "", () => Map.Load(files.Graph));
            Expect.Fails(Status.InvalidArgument, "goal", () => new Follower(new Vec3(0, float.NaN, 0)));
            using (Policy policy = Policy.Shipped())
            using (Agents agents = new Agents(policy, 2))
            {
                AgentErrors(policy, agents);
            }
            using (Graph graph = Graph.Load(files.Graph))
            {
                Expect.Fails(Status.NotFound, "", () => graph.SetEdgeOpen(0, 0, false));
                Expect.Fails(Status.InvalidArgument, "caution", () => graph.FindPath(new PathQuery { Caution = 2 }));
                Expect.Fails(Status.InvalidArgument, "must be 1 to 64", () => graph.FindAlternatives(new PathQuery(), 65));
            }
        }

        private static void AgentErrors(Policy policy, Agents agents)
        {
            SightHit[] hits = new SightHit[Agents.RayCount];
            CharacterState[] states = new CharacterState[1];
            Expect.Fails(Status.InvalidArgument, "policy is null", () => new Agents(null, 1));
            Expect.Fails(Status.InvalidArgument, "max_agents", () => new Agents(policy, 0));
            Body flat = Body.Default;
            flat.Height = 0.1f;
            Expect.Fails(Status.InvalidArgument, "height", () => new Agents(policy, 1, flat));
            Expect.Fails(Status.InvalidArgument, "agent", () => agents.Begin(7, 1));
            Expect.Fails(Status.BadState, "goal", () => agents.Observe(default(ReadOnlySpan<uint>), states, hits));
            agents.SetGoal(0, new Vec3(), new Vec3(1, 0, 3));
            Expect.Fails(Status.BadState, "observe", () => agents.Decide(default(ReadOnlySpan<uint>), new AgentAction[1]));
            Expect.Fails(Status.InvalidArgument, "hits has 64 elements, but this call needs 128", () => agents.Observe(default(ReadOnlySpan<uint>), new CharacterState[2], hits));
            Expect.Fails(Status.InvalidArgument, "ids has 2 elements", () => agents.Observe(new uint[] { 0, 1 }, states, hits));
            states[0].Velocity.X = float.PositiveInfinity;
            Expect.Fails(Status.InvalidArgument, "velocity", () => agents.Observe(default(ReadOnlySpan<uint>), states, hits));
            states[0].Velocity.X = 0;
            agents.Observe(default(ReadOnlySpan<uint>), states, hits);
            Expect.Fails(Status.InvalidArgument, "noise_share", () => agents.Decide(default(ReadOnlySpan<uint>), new AgentAction[1], 2));
            Expect.Fails(Status.BufferTooSmall, "", () => agents.Observation(0, new float[3]));
            Expect.Fails(Status.InvalidArgument, "size is 5", () => agents.Restore(0, new byte[5]));
            Expect.Fails(Status.BadFile, "", () => agents.Restore(0, Enumerable.Repeat((byte)255, agents.Save(0).Length).ToArray()));
        }

        internal static void HandlesAreDestroyedOnce(string path)
        {
            Graph graph = Graph.Load(path);
            graph.Dispose();
            graph.Dispose();
            try
            {
                graph.FindPath(new PathQuery());
                throw new Exception("a disposed graph was searched");
            }
            catch (ObjectDisposedException)
            {
            }
            for (int idx = 0; idx < 100; idx++)
            {
                // Nobody disposes these: their finalizers do it.
                new Follower(new Vec3(1, 2, 3)).Advance(new Vec3(), false);
            }
            GC.Collect();
            GC.WaitForPendingFinalizers();
        }
    }
}
