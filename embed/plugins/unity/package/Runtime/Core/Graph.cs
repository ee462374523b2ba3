using System;
using System.Runtime.InteropServices;

namespace Surefoot
{
    /// <summary>
    /// A proved graph of a level. Any number of threads may search it at once; a change waits for searches to end.
    /// </summary>
    public sealed unsafe class Graph : IDisposable
    {
        /// <summary>Room for legs of a plan at first; few plans have more.</summary>
        private const int UsualLegCount = 64;
        private const int MostAlternatives = 64;

        private Graph(GraphHandle handle)
        {
            Handle = handle;
        }

        internal GraphHandle Handle { get; }

        public GraphInfo Info
        {
            get
            {
                NativeError error;
                GraphInfo info = new GraphInfo { StructSize = (uint)sizeof(GraphInfo) };
                Native.Check(NativeMethods.sf_graph_describe(Handle, &info, &error), &error);
                return info;
            }
        }

        /// <summary>The name of an ability of the body, own moves included: `jump`, or what the file of the move says.</summary>
        public string NameOf(Ability ability)
        {
            NativeAbilityInfo info = Describe(ability);
            return Native.Text(info.Name, NativeAbilityInfo.NameSize);
        }

        /// <summary>What the game plays meanwhile, from the file of an own move; otherwise the name.</summary>
        public string AnimationOf(Ability ability)
        {
            NativeAbilityInfo info = Describe(ability);
            return Native.Text(info.Animation, NativeAbilityInfo.AnimationSize);
        }

        private NativeAbilityInfo Describe(Ability ability)
        {
            NativeError error;
            NativeAbilityInfo info = new NativeAbilityInfo { StructSize = (uint)sizeof(NativeAbilityInfo) };
            Native.Check(NativeMethods.sf_graph_ability(Handle, ability, &info, &error), &error);
            return info;
        }

        /// <summary>Reads a file of `surefoot graph export --format json`; up to a second for 1600 vertices.</summary>
        public static Graph Load(string path)
        {
            Library.RequireLoaded();
            NativeError error;
            GraphHandle handle;
            fixed (byte* text = Native.Utf8(nameof(path), path))
            {
                Native.Check(NativeMethods.sf_graph_load(text, out handle, &error), &error);
            }
            return new Graph(handle);
        }

        /// <summary>Reads the contents of such a file.</summary>
        public static Graph Load(ReadOnlySpan<byte> json)
        {
            Library.RequireLoaded();
            NativeError error;
            GraphHandle handle;
            fixed (byte* first = &MemoryMarshal.GetReference(json))
            {
                Native.Check(NativeMethods.sf_graph_load_memory(first, Native.Size(json.Length), out handle, &error), &error);
            }
            return new Graph(handle);
        }

        /// <summary>The places of all vertices, in the order of their numbers.</summary>
        public Vec3[] Vertices() =>
            Native.All<Vec3>((items, capacity, count, error) => NativeMethods.sf_graph_vertices(Handle, (Vec3*)items, capacity, count, error));

        /// <summary>All edges, as they stand.</summary>
        public Edge[] Edges() =>
            Native.All<Edge>((items, capacity, count, error) => NativeMethods.sf_graph_edges(Handle, (Edge*)items, capacity, count, error));

        /// <summary>Closes an edge, or opens it again, at once: a door, a bridge, a lift.</summary>
        public void SetEdgeOpen(uint from, uint to, bool isOpen)
        {
            NativeError error;
            Native.Check(NativeMethods.sf_graph_set_edge_open(Handle, from, to, isOpen ? 1 : 0, &error), &error);
        }

        /// <summary>Multiplies the proved cost of an edge by a factor, 0.1 to 1000, at once; 1 undoes it.</summary>
        public void SetEdgePrice(uint from, uint to, float factor)
        {
            NativeError error;
            Native.Check(NativeMethods.sf_graph_set_edge_price(Handle, from, to, factor, &error), &error);
        }

        /// <summary>Replaces all designers' edits and prepares the graph again, which takes as long as loading it.</summary>
        public void SetEdits(ReadOnlySpan<Edit> edits)
        {
            NativeError error;
            fixed (Edit* first = &MemoryMarshal.GetReference(edits))
            {
                Native.Check(NativeMethods.sf_graph_edit(Handle, first, Native.Size(edits.Length), &error), &error);
            }
        }

        /// <summary>Adds what NPCs met on edges to the evidence: plans avoid what fails.</summary>
        public void NoteTraversals(ReadOnlySpan<Traversal> traversals)
        {
            NativeError error;
            fixed (Traversal* first = &MemoryMarshal.GetReference(traversals))
            {
                Native.Check(NativeMethods.sf_graph_note_traversals(Handle, first, Native.Size(traversals.Length), &error), &error);
            }
        }

        /// <summary>Finds the cheapest plan. Without a path the plan says why, and leads as near as paths lead.</summary>
        public PlannedPath FindPath(in PathQuery query) => FindPath(query, default(ReadOnlySpan<LegKey>));

        /// <summary>Finds the cheapest plan that uses none of some legs.</summary>
        public PlannedPath FindPath(in PathQuery query, ReadOnlySpan<LegKey> avoid)
        {
            NativeError error;
            Leg[] legs = new Leg[UsualLegCount];
            fixed (LegKey* firstAvoided = &MemoryMarshal.GetReference(avoid))
            {
                NativeQuery asked = Asked(query, firstAvoided, avoid.Length);
                for (;;)
                {
                    Plan plan;
                    UIntPtr count;
                    Status status;
                    fixed (Leg* first = legs)
                    {
                        status = NativeMethods.sf_graph_find_path(Handle, &asked, first, Native.Size(legs.Length), &count, &plan, &error);
                    }
                    if (status != Status.BufferTooSmall)
                    {
                        Native.Check(status, &error);
                        Array.Resize(ref legs, (int)count);
                        return new PlannedPath(plan, legs);
                    }
                    legs = new Leg[(int)count];
                }
            }
        }

        /// <summary>Finds up to `most` plans, 1 to 64: the cheapest, then those that do without one of its legs, the cheapest first.</summary>
        public PlannedPath[] FindAlternatives(in PathQuery query, int most)
        {
            if (most < 1 || most > MostAlternatives)
            {
                throw new SurefootException(Status.InvalidArgument, $"most is {most}, but must be 1 to {MostAlternatives}");
            }
            NativeError error;
            NativeQuery asked = Asked(query, null, 0);
            Plan[] plans = new Plan[most];
            Leg[] legs = new Leg[UsualLegCount * most];
            for (;;)
            {
                UIntPtr planCount;
                UIntPtr legCount;
                Status status;
                fixed (Plan* firstPlan = plans)
                fixed (Leg* firstLeg = legs)
                {
                    status = NativeMethods.sf_graph_find_alternatives(
                        Handle, &asked, firstPlan, Native.Size(most), &planCount, firstLeg, Native.Size(legs.Length), &legCount, &error);
                }
                if (status != Status.BufferTooSmall)
                {
                    Native.Check(status, &error);
                    return Paths(plans.AsSpan(0, (int)planCount), legs);
                }
                legs = new Leg[(int)legCount];
            }
        }

        public void Dispose() => Handle.Dispose();

        private static PlannedPath[] Paths(ReadOnlySpan<Plan> plans, Leg[] legs)
        {
            PlannedPath[] paths = new PlannedPath[plans.Length];
            for (int idx = 0; idx < paths.Length; idx++)
            {
                paths[idx] = new PlannedPath(plans[idx], legs.AsSpan((int)plans[idx].FirstLeg, (int)plans[idx].LegCount).ToArray());
            }
            return paths;
        }

        private static NativeQuery Asked(in PathQuery query, LegKey* avoid, int avoidCount) => new NativeQuery
        {
            StructSize = (uint)sizeof(NativeQuery),
            Without = query.Without,
            Start = query.Start,
            Goal = query.Goal,
            Caution = query.Caution,
            AvoidCount = (uint)avoidCount,
            Avoid = avoid,
        };
    }
}
