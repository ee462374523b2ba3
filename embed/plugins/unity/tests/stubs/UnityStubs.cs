// STUBS, NOT UNITY. Just enough of the engine's public surface, written from its documentation, to compile the parts of the package that use
// it. Nothing here does anything: that the package works in the editor is not shown by compiling it.
#pragma warning disable CS0067, CS0169, CS0414, CS0649
using System;

namespace UnityEngine
{
    public class Object
    {
        public string name { get; set; }
        public static T FindFirstObjectByType<T>() where T : Object => null;
        public static implicit operator bool(Object found) => !ReferenceEquals(found, null);
    }

    public class Component : Object
    {
        public Transform transform { get; }
        public GameObject gameObject { get; }
        public T GetComponent<T>() => default(T);
    }

    public class Behaviour : Component
    {
    }

    public class MonoBehaviour : Behaviour
    {
    }

    public class ScriptableObject : Object
    {
        public static T CreateInstance<T>() where T : ScriptableObject => null;
    }

    public class TextAsset : Object
    {
        public byte[] bytes => null;
    }

    public sealed class GameObject : Object
    {
        public GameObject(string name)
        {
        }

        public Transform transform { get; }
        public int layer { get; set; }
        public T AddComponent<T>() where T : Component => null;
    }

    public class Transform : Component
    {
        public Vector3 position { get; set; }
        public Vector3 localPosition { get; set; }
        public Vector3 eulerAngles { get; set; }
        public Quaternion rotation { get; set; }
        public Vector3 lossyScale { get; }
        public Vector3 TransformPoint(Vector3 position) => position;
        public void SetParent(Transform parent, bool worldPositionStays)
        {
        }
    }

    public class Collider : Component
    {
    }

    public class BoxCollider : Collider
    {
        public Vector3 center { get; set; }
        public Vector3 size { get; set; }
    }

    [Flags]
    public enum CollisionFlags
    {
        None = 0,
    }

    public class CharacterController : Collider
    {
        public bool isGrounded { get; }
        public Vector3 center { get; set; }
        public float height { get; set; }
        public float radius { get; set; }
        public float slopeLimit { get; set; }
        public float stepOffset { get; set; }
        public CollisionFlags Move(Vector3 motion) => CollisionFlags.None;
    }

    public struct Vector3
    {
        public float x;
        public float y;
        public float z;

        public Vector3(float x, float y, float z)
        {
            this.x = x;
            this.y = y;
            this.z = z;
        }

        public static Vector3 zero => default(Vector3);
        public static Vector3 up => default(Vector3);
        public static Vector3 down => default(Vector3);
        public static Vector3 Scale(Vector3 left, Vector3 right) => left;
        public static Vector3 operator +(Vector3 left, Vector3 right) => left;
        public static Vector3 operator -(Vector3 left, Vector3 right) => left;
        public static Vector3 operator *(Vector3 left, float right) => left;
        public static Vector3 operator /(Vector3 left, float right) => left;
    }

    public struct Quaternion
    {
        public static Quaternion Euler(float x, float y, float z) => default(Quaternion);
    }

    public static class Mathf
    {
        public const float Deg2Rad = (float)(Math.PI / 180);
        public static float Abs(float value) => value;
        public static float Max(float left, float right) => left;
        public static int Min(int left, int right) => left;
        public static int RoundToInt(float value) => 0;
    }

    public static class Time
    {
        public static float fixedDeltaTime { get; set; }
    }

    public struct LayerMask
    {
        public static implicit operator int(LayerMask mask) => 0;
        public static implicit operator LayerMask(int mask) => default(LayerMask);
    }

    public enum QueryTriggerInteraction
    {
        UseGlobal,
        Ignore,
        Collide,
    }

    public struct QueryParameters
    {
        public QueryParameters(int layerMask, bool hitMultipleFaces, QueryTriggerInteraction hitTriggers, bool hitBackfaces)
        {
        }
    }

    public static class Physics
    {
        public const int DefaultRaycastLayers = ~(1 << 2);
    }

    public struct RaycastHit
    {
        public float distance { get; set; }
        public Collider collider { get; }
    }

    public struct RaycastCommand
    {
        public RaycastCommand(Vector3 from, Vector3 direction, QueryParameters queryParameters, float distance)
        {
        }

        public static Unity.Jobs.JobHandle ScheduleBatch(
            Unity.Collections.NativeArray<RaycastCommand> commands,
            Unity.Collections.NativeArray<RaycastHit> results,
            int minCommandsPerJob,
            Unity.Jobs.JobHandle dependsOn = default(Unity.Jobs.JobHandle)) => default(Unity.Jobs.JobHandle);
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class SerializeField : Attribute
    {
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class HideInInspector : Attribute
    {
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class TooltipAttribute : Attribute
    {
        public TooltipAttribute(string tooltip)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class RangeAttribute : Attribute
    {
        public RangeAttribute(float min, float max)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class RequireComponent : Attribute
    {
        public RequireComponent(Type requiredComponent)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class AddComponentMenu : Attribute
    {
        public AddComponentMenu(string menuName)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class DefaultExecutionOrder : Attribute
    {
        public DefaultExecutionOrder(int order)
        {
        }
    }
}

namespace Unity.Jobs
{
    public struct JobHandle
    {
        public void Complete()
        {
        }
    }
}

namespace Unity.Collections
{
    public enum Allocator
    {
        Persistent = 4,
    }

    public struct NativeArray<T> : IDisposable where T : struct
    {
        public NativeArray(int length, Allocator allocator)
        {
        }

        public T this[int index]
        {
            get => default(T);
            set { }
        }

        public NativeArray<T> GetSubArray(int start, int length) => this;

        public void Dispose()
        {
        }
    }
}

namespace Unity.AI.Navigation
{
    public class NavMeshLink : UnityEngine.MonoBehaviour
    {
        public UnityEngine.Vector3 startPoint { get; set; }
        public UnityEngine.Vector3 endPoint { get; set; }
        public float width { get; set; }
#if SUREFOOT_AI_NAVIGATION_2
        public float costModifier { get; set; }
#else
        public int costModifier { get; set; }
#endif
        public bool bidirectional { get; set; }
        public int area { get; set; }
    }
}

namespace UnityEditor
{
    [AttributeUsage(AttributeTargets.Method)]
    public sealed class MenuItem : Attribute
    {
        public MenuItem(string itemName)
        {
        }
    }

    public static class AssetDatabase
    {
        public static string GetAssetPath(UnityEngine.Object assetObject) => "";
    }

    public static class EditorUtility
    {
        public static string OpenFilePanel(string title, string directory, string extension) => "";
        public static bool DisplayDialog(string title, string message, string ok) => true;
    }

    public static class Undo
    {
        public static void RegisterCreatedObjectUndo(UnityEngine.Object objectToUndo, string name)
        {
        }
    }

    public static class Selection
    {
        public static UnityEngine.GameObject activeGameObject { get; set; }
    }
}

namespace UnityEditor.AssetImporters
{
    public class AssetImportContext
    {
        public string assetPath { get; }
        public void AddObjectToAsset(string identifier, UnityEngine.Object obj)
        {
        }

        public void SetMainObject(UnityEngine.Object obj)
        {
        }

        public void LogImportError(string msg, UnityEngine.Object obj = null)
        {
        }

        public void DependsOnSourceAsset(string path)
        {
        }
    }

    public abstract class ScriptedImporter : UnityEngine.Object
    {
        public abstract void OnImportAsset(AssetImportContext ctx);
    }

    [AttributeUsage(AttributeTargets.Class)]
    public class ScriptedImporterAttribute : Attribute
    {
        public ScriptedImporterAttribute(int version, string ext)
        {
        }
    }
}
