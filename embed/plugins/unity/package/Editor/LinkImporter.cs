using System.Collections.Generic;
using System.IO;
using Surefoot.Unity;
using Unity.AI.Navigation;
using UnityEditor;
using UnityEngine;

namespace Surefoot.Editor
{
    /// <summary>Turns a file of `surefoot graph export --format unity` into NavMeshLink components below one object.</summary>
    public static class LinkImporter
    {
        private const string Title = "Import NavMesh Links";

        [MenuItem("Tools/Surefoot/" + Title + "...")]
        private static void ImportFile()
        {
            string path = EditorUtility.OpenFilePanel("Links of `surefoot graph export --format unity`", "", "json");
            if (string.IsNullOrEmpty(path))
            {
                return;
            }
            try
            {
                string text = File.ReadAllText(path);
                Vec3 origin = LinkFile.Origin(text) ?? AskForOrigin();
                GameObject root = Build(LinkFile.Parse(text), Path.GetFileNameWithoutExtension(path), origin);
                Undo.RegisterCreatedObjectUndo(root, Title);
                Selection.activeGameObject = root;
            }
            catch (SurefootException error)
            {
                EditorUtility.DisplayDialog(Title, $"{path}: {error.Message}", "OK");
            }
        }

        /// <summary>Files of earlier versions do not say where the level's origin lies.</summary>
        private static Vec3 AskForOrigin()
        {
            string level = EditorUtility.OpenFilePanel("Level that they were proved on; cancel for one of `surefoot map export`", "", "glb,gltf,obj");
            return string.IsNullOrEmpty(level) ? default(Vec3) : LevelOrigin.Of(level);
        }

        /// <summary>Makes an object with a child for each link. `origin` is where the level's origin lies on the map, m.</summary>
        public static GameObject Build(List<LinkEntry> links, string name, Vec3 origin)
        {
            GameObject root = new GameObject(name);
            // Links are on the map, and the root takes them to the level.
            root.transform.position = new UnityFrame(origin).FromMap(default(Vec3)).ToVector3();
            foreach (LinkEntry link in links)
            {
                AddLink(root.transform, link);
            }
            return root;
        }

        private static void AddLink(Transform root, LinkEntry entry)
        {
            GameObject child = new GameObject(string.IsNullOrEmpty(entry.Ability) ? "link" : entry.Ability);
            child.transform.SetParent(root, false);
            child.transform.localPosition = entry.StartPoint.ToVector3();
            NavMeshLink link = child.AddComponent<NavMeshLink>();
            link.startPoint = Vector3.zero;
            link.endPoint = (entry.EndPoint - entry.StartPoint).ToVector3();
            link.width = entry.Width;
            link.bidirectional = entry.Bidirectional;
            link.area = entry.Area;
#if SUREFOOT_AI_NAVIGATION_2
            link.costModifier = entry.CostModifier;
#else
            link.costModifier = Mathf.RoundToInt(entry.CostModifier);
#endif
            Describe(child.AddComponent<SurefootLink>(), entry);
        }

        private static void Describe(SurefootLink link, LinkEntry entry)
        {
            link.ability = entry.Ability;
            link.chance = entry.Chance;
            link.seconds = entry.Seconds;
            link.leaps = new SurefootLink.Leap[entry.Leaps.Count];
            for (int idx = 0; idx < link.leaps.Length; idx++)
            {
                LinkLeap leap = entry.Leaps[idx];
                link.leaps[idx].ability = leap.Ability;
                link.leaps[idx].takeOff = leap.TakeOff.ToVector3();
                link.leaps[idx].apex = leap.Apex.ToVector3();
                link.leaps[idx].landing = leap.Landing.ToVector3();
                link.leaps[idx].seconds = leap.Seconds;
            }
        }
    }
}
