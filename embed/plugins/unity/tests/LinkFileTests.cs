using System.Collections.Generic;
using System.IO;
using System.Linq;
using Surefoot.Editor;

namespace Surefoot.Tests
{
    internal static class LinkFileTests
    {
        internal static void ReadsTheFormat(string path)
        {
            List<LinkEntry> links = LinkFile.Parse(File.ReadAllText(path));
            Expect.Equal(links.Count, 2, "the number of links");
            LinkEntry jump = links[0];
            Expect.Equal(jump.StartPoint, new Vec3(-31.5f, 19, 59.9f), "startPoint");
            Expect.Equal(jump.EndPoint, new Vec3(-49.2f, 10.2f, 63.5f), "endPoint");
            Expect.Equal(jump.CostModifier, 1.75f, "costModifier");
            Expect.Equal(jump.Area, 5, "area");
            Expect.Equal(jump.Ability, "double-jump", "ability");
            Expect.Equal(jump.Chance, 0.92f, "chance");
            Expect.Equal(jump.Seconds, 2.5f, "seconds");
            Expect.Equal(jump.Leaps.Count, 2, "the number of leaps");
            Expect.Equal(jump.Leaps[1].Apex, new Vec3(-44, 14, 62), "the apex of the second leap");
            Expect.Equal(links[1].Leaps.Count, 0, "the number of leaps of a link without any");
        }

        /// <summary>Files say where the level's origin lies, links on Unity's axes and graphs on Surefoot's.</summary>
        internal static void ReadsOrigins()
        {
            Expect.Equal(LinkFile.Origin("{\"origin\": {\"x\": -2, \"y\": 1, \"z\": 3.5}, \"links\": []}").Value, new Vec3(2, 1, 3.5f), "of links");
            Expect.Equal(LinkFile.OriginOfGraph("{\"graph\": {\"origin\": [2, 1, 3.5]}}").Value, new Vec3(2, 1, 3.5f), "of a graph");
            Expect.That(LinkFile.Origin("{\"links\": []}") == null && LinkFile.OriginOfGraph("{\"graph\": {}}") == null, "files without one");
        }

        /// <summary>Both ends of every link lie on the map, mirrored.</summary>
        internal static void ReadsExported(Files files)
        {
            if (files.Exported == null)
            {
                return;
            }
            List<LinkEntry> links = LinkFile.Parse(File.ReadAllText(files.Exported));
            Expect.That(links.Count > 0, "there are links");
            using (Map map = Map.Load(files.Level))
            {
                foreach (Vec3 end in links.SelectMany(link => new[] { link.StartPoint, link.EndPoint }))
                {
                    Vec3 place = UnityFrame.Mirror(end);
                    Expect.That(place.X >= 0 && place.X <= map.Extent.X && place.Z >= 0 && place.Z <= map.Extent.Z, $"{place} is on the map");
                }
            }
        }

        internal static void IsTolerant()
        {
            const string text = "\ufeff [{ \"start_point\": [1, 2.5e0, -3], \"EndPoint\": {\"X\": 4, \"y\": 5, \"z\": 6}, \"later\": [null, true, {}],"
                + " \"ability\": \"ju\\u006dp\", \"takeOff\": [1, 2, 3], \"apex\": [2, 4, 3], \"landing\": [4, 5, 6] }]";
            LinkEntry link = LinkFile.Parse(text)[0];
            Expect.Equal(link.StartPoint, new Vec3(1, 2.5f, -3), "a point as an array");
            Expect.Equal(link.EndPoint, new Vec3(4, 5, 6), "a point as an object");
            Expect.Equal(link.Ability, "jump", "a text with an escaped character");
            Expect.Equal(link.Leaps[0].Apex, new Vec3(2, 4, 3), "the apex of a link with one leap");
            Expect.Equal(link.CostModifier, -1, "a cost that is missing");
            Expect.Equal(LinkFile.Parse("{\"links\": []}").Count, 0, "the number of links of an empty file");
        }

        internal static void RefusesByName()
        {
            Expect.Fails(Status.BadFile, "has no list of links", () => LinkFile.Parse("{}"));
            Expect.Fails(Status.BadFile, "has version 2", () => LinkFile.Parse("{\"version\": 2, \"links\": []}"));
            Expect.Fails(Status.BadFile, "line 2 is no JSON", () => LinkFile.Parse("{\n\"links\": [}"));
            Expect.Fails(Status.BadFile, "end of the file", () => LinkFile.Parse("[] []"));
            Expect.Fails(Status.BadFile, "at most 32", () => LinkFile.Parse(new string('[', 100000)));
            Expect.Fails(Status.BadFile, "links[0].startPoint is no point", () => LinkFile.Parse("[{}]"));
            Expect.Fails(Status.BadFile, "links[0].endPoint.z is no number", () => LinkFile.Parse("[{\"startPoint\": [0,0,0], \"endPoint\": {\"x\": 0, \"y\": 1}}]"));
            Expect.Fails(Status.BadFile, "links[0].area is 32", () => LinkFile.Parse("[{\"startPoint\": [0,0,0], \"endPoint\": [0,0,0], \"area\": 32}]"));
            Expect.Fails(Status.BadFile, "text is null", () => LinkFile.Parse(null));
        }
    }
}
