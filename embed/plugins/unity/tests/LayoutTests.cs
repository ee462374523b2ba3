using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Reflection;
using System.Runtime.InteropServices;

namespace Surefoot.Tests
{
    internal static class LayoutTests
    {
        private static readonly Dictionary<string, string> TypeNames = new Dictionary<string, string>
        {
            ["sf_error"] = "NativeError",
            ["sf_vec3"] = "Vec3",
            ["sf_place"] = "LevelPlace",
            ["sf_frame"] = "LevelFrame",
            ["sf_ray"] = "SightRay",
            ["sf_hit"] = "SightHit",
            ["sf_action"] = "AgentAction",
            ["sf_other"] = "OtherCharacter",
            ["sf_block"] = "Block",
            ["sf_device"] = "Device",
            ["sf_body"] = "Body",
            ["sf_state"] = "CharacterState",
            ["sf_locomotion"] = "Locomotion",
            ["sf_progress"] = "Progress",
            ["sf_leg_key"] = "LegKey",
            ["sf_query"] = "NativeQuery",
            ["sf_leg"] = "Leg",
            ["sf_plan"] = "Plan",
            ["sf_edge"] = "Edge",
            ["sf_graph_info"] = "GraphInfo",
            ["sf_ability_info"] = "NativeAbilityInfo",
            ["sf_edit"] = "Edit",
            ["sf_traversal"] = "Traversal",
            ["sf_step"] = "FollowStep",
            ["sf_gait"] = "Gait",
            ["sf_outcome"] = "Outcome",
        };

        private static readonly string[] Prefixes = { "SF_SURFACE_", "SF_STEP_", "SF_COORDINATES_", "SF_PACE_", "SF_MOVE_", "SF_" };

        /// <summary>The file has lines `size STRUCT BYTES`, `offset STRUCT FIELD BYTES` and `constant NAME VALUE`.</summary>
        internal static void AreThoseOfTheHeader(string path)
        {
            int count = 0;
            foreach (string[] words in File.ReadLines(path).Select(line => line.Split(' ')))
            {
                count++;
                switch (words[0])
                {
                    case "size":
                        Expect.Equal(Marshal.SizeOf(TypeOf(words[1])), int.Parse(words[2]), $"the size of {words[1]}");
                        break;
                    case "offset":
                        Expect.Equal(Offset(words[1], words[2]), int.Parse(words[3]), $"the offset of {words[1]}.{words[2]}");
                        break;
                    default:
                        CheckConstant(words[1], long.Parse(words[2]));
                        break;
                }
            }
            Expect.That(count > 150, "the header has many structs, fields and constants");
            Expect.Equal(Agents.RayCount, 64, "SF_RAY_COUNT");
        }

        private static Type TypeOf(string c)
        {
            Expect.That(TypeNames.ContainsKey(c), $"{c} has a struct in C#");
            return typeof(Vec3).Assembly.GetType("Surefoot." + TypeNames[c], true);
        }

        private static int Offset(string structure, string field)
        {
            Type type = TypeOf(structure);
            FieldInfo found = type.GetField(Pascal(field), BindingFlags.Instance | BindingFlags.Public | BindingFlags.NonPublic);
            Expect.That(found != null, $"{type.Name} has a field {Pascal(field)}");
            return (int)Marshal.OffsetOf(type, found.Name);
        }

        private static void CheckConstant(string name, long value)
        {
            bool isBit = name.EndsWith("_BIT");
            string plain = isBit ? name.Substring(0, name.Length - 4) : name;
            string rest = plain.Substring(Prefixes.First(plain.StartsWith).Length);
            IEnumerable<Type> enums = isBit ? new[] { typeof(Abilities) } : typeof(Vec3).Assembly.GetTypes().Where(type => type.IsEnum);
            bool isThere = enums.Any(type =>
                Enum.IsDefined(type, Pascal(rest)) && Convert.ToInt64(Enum.Parse(type, Pascal(rest))) == value);
            Expect.That(isThere, $"{name} is {value} in an enum");
        }

        private static string Pascal(string name) =>
            string.Concat(name.ToLowerInvariant().Split('_').Select(word => char.ToUpperInvariant(word[0]) + word.Substring(1)));
    }
}
