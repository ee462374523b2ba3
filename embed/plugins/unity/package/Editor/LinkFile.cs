// The reader of `surefoot graph export --format unity`, without types of the engine. It is tolerant: fields that it does not know are
// ignored, names may be written in snake, camel or Pascal case, points as arrays or as objects, and what describes a link may stand in
// `about` or beside its ends. Only the ends must be there.
using System;
using System.Collections.Generic;
using System.Globalization;
using System.Text;

namespace Surefoot.Editor
{
    /// <summary>One move off the ground, as a hint for an animation. Places are on the map, on Unity's axes, m.</summary>
    public struct LinkLeap
    {
        public string Ability;
        public Vec3 TakeOff;
        public Vec3 Apex;
        public Vec3 Landing;
        public float Seconds;
    }

    /// <summary>A link of a NavMesh. Places are on the map, on Unity's axes, m.</summary>
    public sealed class LinkEntry
    {
        public Vec3 StartPoint;
        public Vec3 EndPoint;
        public float Width;
        public bool Bidirectional;
        /// <summary>Cost of a metre of the link compared with a metre of walking; below 0 for the cost of the area.</summary>
        public float CostModifier = -1;
        public int Area;
        public string Ability = "";
        /// <summary>Estimated chance that an NPC with the policy gets through, 0 to 1.</summary>
        public float Chance = 1;
        public float Seconds;
        public readonly List<LinkLeap> Leaps = new List<LinkLeap>();
    }

    /// <summary>The links of a file.</summary>
    public static class LinkFile
    {
        /// <summary>Files of later versions have fields that mean something else.</summary>
        private const int Version = 1;
        private const int LastArea = 31;

        /// <summary>Reads the text of a file; throws what is wrong with it, and where.</summary>
        public static List<LinkEntry> Parse(string text)
        {
            if (text == null)
            {
                throw Bad("the text is null, but must be that of a file of `surefoot graph export --format unity`");
            }
            object document = Json.Parse(text);
            Fields fields = new Fields(document as Dictionary<string, object>, "the file");
            int version = (int)fields.Number("version", Version);
            if (version > Version)
            {
                throw Bad($"the file has version {version}, but this package reads up to {Version}: take both from one release");
            }
            List<object> items = document as List<object> ?? fields.Get("links") as List<object>;
            if (items == null)
            {
                throw Bad("the file has no list of links: write it with `surefoot graph export --format unity`");
            }
            List<LinkEntry> links = new List<LinkEntry>();
            foreach (object item in items)
            {
                links.Add(Link(item, $"links[{links.Count}]"));
            }
            return links;
        }

        /// <summary>Where the level's origin lies on the map, m, in Surefoot's frame, as a file of links says it; null if it does not.</summary>
        public static Vec3? Origin(string text)
        {
            Fields fields = new Fields(Json.Parse(text) as Dictionary<string, object>, "the file");
            return fields.Get("origin") == null ? (Vec3?)null : UnityFrame.Mirror(fields.Point("origin"));
        }

        /// <summary>Reads a file of `surefoot graph export --format json`.</summary>
        public static Vec3? OriginOfGraph(string text)
        {
            Fields fields = new Fields(Json.Parse(text) as Dictionary<string, object>, "the file");
            Fields graph = new Fields(fields.Get("graph") as Dictionary<string, object>, "graph");
            return graph.Get("origin") == null ? (Vec3?)null : graph.Point("origin");
        }

        private static LinkEntry Link(object item, string name)
        {
            Fields fields = new Fields(item as Dictionary<string, object>, name);
            Fields about = new Fields(fields.Get("about") as Dictionary<string, object> ?? item as Dictionary<string, object>, name);
            LinkEntry link = new LinkEntry();
            link.StartPoint = fields.Point("startPoint");
            link.EndPoint = fields.Point("endPoint");
            link.Width = fields.Number("width", link.Width);
            link.Bidirectional = fields.Get("bidirectional") is bool isBoth && isBoth;
            link.CostModifier = fields.Number("costModifier", link.CostModifier);
            link.Area = (int)fields.Number("area", link.Area);
            link.Ability = about.Get("ability") as string ?? link.Ability;
            link.Chance = about.Number("chance", link.Chance);
            link.Seconds = about.Number("seconds", link.Seconds);
            if (link.Area < 0 || link.Area > LastArea)
            {
                throw Bad($"{name}.area is {link.Area}, but Unity has areas 0 to {LastArea}");
            }
            AddLeaps(link, about, name);
            return link;
        }

        private static void AddLeaps(LinkEntry link, Fields about, string name)
        {
            if (about.Get("leaps") is List<object> leaps)
            {
                foreach (object leap in leaps)
                {
                    link.Leaps.Add(Leap(new Fields(leap as Dictionary<string, object>, $"{name}.leaps[{link.Leaps.Count}]"), link));
                }
            }
            else if (about.Get("takeOff") != null)
            {
                link.Leaps.Add(Leap(about, link));
            }
        }

        private static LinkLeap Leap(Fields fields, LinkEntry link) => new LinkLeap
        {
            Ability = fields.Get("ability") as string ?? link.Ability,
            TakeOff = fields.Point("takeOff"),
            Apex = fields.Point("apex"),
            Landing = fields.Point("landing"),
            Seconds = fields.Number("seconds", 0),
        };

        private static SurefootException Bad(string message) => new SurefootException(Status.BadFile, message);

        /// <summary>The fields of an object, under names without case and underscores.</summary>
        private struct Fields
        {
            private readonly Dictionary<string, object> values;
            private readonly string name;

            internal Fields(Dictionary<string, object> raw, string name)
            {
                this.name = name;
                values = new Dictionary<string, object>();
                foreach (KeyValuePair<string, object> field in raw ?? values)
                {
                    values[Plain(field.Key)] = field.Value;
                }
            }

            /// <summary>The value of a field; null if it is null or missing.</summary>
            internal object Get(string field)
            {
                values.TryGetValue(Plain(field), out object value);
                return value;
            }

            internal float Number(string field, float missing)
            {
                object value = Get(field);
                if (value == null)
                {
                    return missing;
                }
                return Finite(value, $"{name}.{field}");
            }

            internal Vec3 Point(string field)
            {
                string whole = $"{name}.{field}";
                object value = Get(field);
                if (value is List<object> list && list.Count == 3)
                {
                    return new Vec3(Finite(list[0], whole), Finite(list[1], whole), Finite(list[2], whole));
                }
                if (value is Dictionary<string, object> raw)
                {
                    Fields axes = new Fields(raw, whole);
                    return new Vec3(
                        Finite(axes.Get("x"), whole + ".x"), Finite(axes.Get("y"), whole + ".y"), Finite(axes.Get("z"), whole + ".z"));
                }
                throw Bad($"{whole} is no point: it must be {{\"x\": 0, \"y\": 0, \"z\": 0}} or [0, 0, 0]");
            }

            private static float Finite(object value, string whole)
            {
                if (value is double number && Math.Abs(number) <= float.MaxValue)
                {
                    return (float)number;
                }
                throw Bad($"{whole} is no number");
            }

            private static string Plain(string field) => field.Replace("_", "").ToLowerInvariant();
        }

        /// <summary>JSON as objects: dictionaries, lists, strings, doubles, booleans and null.</summary>
        private sealed class Json
        {
            /// <summary>Deeper files are no links, and would overflow the stack.</summary>
            private const int MostDepth = 32;

            private readonly string text;
            private int at;
            private int depth;

            private Json(string text)
            {
                this.text = text;
            }

            internal static object Parse(string text)
            {
                // Editors on Windows put a byte order mark in front.
                Json json = new Json(text.TrimStart('\ufeff'));
                object value = json.Value();
                json.SkipSpace();
                return json.at == json.text.Length ? value : throw json.Wrong("the end of the file");
            }

            private object Value()
            {
                SkipSpace();
                switch (at < text.Length ? text[at] : '\0')
                {
                    case '{':
                        return Object();
                    case '[':
                        return List();
                    case '"':
                        return String();
                    case 't':
                        return Word("true", true);
                    case 'f':
                        return Word("false", false);
                    case 'n':
                        return Word("null", null);
                    default:
                        return Number();
                }
            }

            private Dictionary<string, object> Object()
            {
                Dictionary<string, object> values = new Dictionary<string, object>();
                Enter();
                if (!Takes('}'))
                {
                    do
                    {
                        SkipSpace();
                        string name = String();
                        Take(':');
                        values[name] = Value();
                    }
                    while (Takes(','));
                    Take('}');
                }
                depth--;
                return values;
            }

            private List<object> List()
            {
                List<object> values = new List<object>();
                Enter();
                if (!Takes(']'))
                {
                    do
                    {
                        values.Add(Value());
                    }
                    while (Takes(','));
                    Take(']');
                }
                depth--;
                return values;
            }

            private string String()
            {
                StringBuilder found = new StringBuilder();
                Take('"');
                while (at < text.Length && text[at] != '"')
                {
                    found.Append(text[at] == '\\' ? Escaped() : text[at++]);
                }
                Take('"', false);
                return found.ToString();
            }

            private char Escaped()
            {
                const string names = "\"\\/bfnrt";
                const string meant = "\"\\/\b\f\n\r\t";
                at++;
                char name = at < text.Length ? text[at++] : '\0';
                if (name == 'u' && at + 4 <= text.Length
                    && ushort.TryParse(text.Substring(at, 4), NumberStyles.AllowHexSpecifier, CultureInfo.InvariantCulture, out ushort code))
                {
                    at += 4;
                    return (char)code;
                }
                int idx = names.IndexOf(name);
                return idx >= 0 ? meant[idx] : throw Wrong("an escaped character");
            }

            private object Number()
            {
                int begin = at;
                while (at < text.Length && (char.IsDigit(text[at]) || "+-.eE".IndexOf(text[at]) >= 0))
                {
                    at++;
                }
                string digits = text.Substring(begin, at - begin);
                if (double.TryParse(digits, NumberStyles.Float, CultureInfo.InvariantCulture, out double value))
                {
                    return value;
                }
                at = begin;
                throw Wrong("a value");
            }

            private object Word(string word, object value)
            {
                if (string.CompareOrdinal(text, at, word, 0, word.Length) != 0)
                {
                    throw Wrong("a value");
                }
                at += word.Length;
                return value;
            }

            private void Enter()
            {
                at++;
                if (++depth > MostDepth)
                {
                    throw Wrong($"at most {MostDepth} brackets within each other");
                }
            }

            private bool Takes(char wanted)
            {
                SkipSpace();
                bool isThere = at < text.Length && text[at] == wanted;
                at += isThere ? 1 : 0;
                return isThere;
            }

            private void Take(char wanted, bool skipsSpace = true)
            {
                if (skipsSpace)
                {
                    SkipSpace();
                }
                if (at >= text.Length || text[at] != wanted)
                {
                    throw Wrong(wanted.ToString());
                }
                at++;
            }

            private void SkipSpace()
            {
                while (at < text.Length && char.IsWhiteSpace(text[at]))
                {
                    at++;
                }
            }

            private SurefootException Wrong(string expected)
            {
                int line = 1;
                for (int idx = 0; idx < at && idx < text.Length; idx++)
                {
                    line += text[idx] == '\n' ? 1 : 0;
                }
                return Bad($"line {line} is no JSON: {expected} was expected; export the file again");
            }
        }
    }
}
