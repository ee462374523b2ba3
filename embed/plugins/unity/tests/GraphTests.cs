using System;
using System.Linq;

namespace Surefoot.Tests
{
    internal static class GraphTests
    {
        internal static void FollowsChanges(string path)
        {
            using (Graph graph = Graph.Load(path))
            {
                PathQuery query = LongQuery(graph);
                PlannedPath before = graph.FindPath(query);
                Expect.That(before.IsFound && before.Plan.LegCount == before.Legs.Length, "a path is found");
                Expect.Near(before.Legs.Last().Waypoint, query.Goal, 0.01f, "the last waypoint");
                LegKey edge = before.Legs.First(leg => leg.Key.IsEdge).Key;

                graph.SetEdgeOpen(edge.From, edge.To, false);
                Expect.That(!Uses(graph.FindPath(query), edge), "a closed edge is not used");
                Expect.That(graph.Edges().Single(found => found.Key.Equals(edge)).IsOpen == 0, "the edge is shown as closed");
                graph.SetEdgeOpen(edge.From, edge.To, true);
                Expect.That(Uses(graph.FindPath(query), edge), "an open edge is used");

                Expect.That(!Uses(graph.FindPath(query, new[] { edge }), edge), "a leg to avoid is not used");

                graph.SetEdgePrice(edge.From, edge.To, 1000);
                Expect.That(!Uses(graph.FindPath(query), edge), "an expensive edge is not used");
                graph.SetEdgePrice(edge.From, edge.To, 1);

                uint edgeCount = graph.Info.EdgeCount;
                Vec3[] places = graph.Vertices();
                graph.SetEdits(new[] { new Edit { Kind = EditKind.ForbidEdge, From = places[edge.From], To = places[edge.To] } });
                Expect.Equal(graph.Info.EdgeCount, edgeCount - 1, "the number of edges after an edit");
                graph.SetEdits(default(ReadOnlySpan<Edit>));
                Expect.Equal(graph.Info.EdgeCount, edgeCount, "the number of edges without edits");
            }
        }

        internal static void FindsAlternatives(string path)
        {
            byte[] json = System.IO.File.ReadAllBytes(path);
            using (Graph graph = Graph.Load(json))
            {
                PathQuery query = LongQuery(graph);
                PlannedPath[] paths = graph.FindAlternatives(query, 4);
                Expect.That(paths.Length > 1, "there are alternatives");
                Expect.That(paths.All(found => found.Legs.Length > 0), "each has legs");
                Expect.That(paths[0].Legs.Any(leg => !Uses(paths[1], leg.Key)), "the second does without a leg of the first");
                Expect.Near(paths[0].Plan.Seconds, graph.FindPath(query).Plan.Seconds, 1e-3f, "the cheapest");
            }
        }

        /// <summary>Two vertices between which a plan has several edges.</summary>
        private static PathQuery LongQuery(Graph graph)
        {
            Vec3[] places = graph.Vertices();
            return places
                .Select(goal => new PathQuery(places[0], goal))
                .First(query => graph.FindPath(query).IsFound && graph.FindPath(query).Legs.Count(leg => leg.Key.IsEdge) > 2);
        }

        private static bool Uses(PlannedPath path, LegKey key) => path.Legs.Any(leg => leg.Key.Equals(key));
    }
}
