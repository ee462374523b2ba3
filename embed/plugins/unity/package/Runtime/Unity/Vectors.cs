using UnityEngine;

namespace Surefoot.Unity
{
    /// <summary>The same three numbers in the vectors of engine and library; <see cref="UnityFrame"/> converts what they mean.</summary>
    public static class Vectors
    {
        public static Vec3 ToVec3(this Vector3 vector) => new Vec3(vector.x, vector.y, vector.z);

        public static Vector3 ToVector3(this Vec3 vector) => new Vector3(vector.X, vector.Y, vector.Z);
    }
}
