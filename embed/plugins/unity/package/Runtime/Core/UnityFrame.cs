using System;

namespace Surefoot
{
    /// <summary>
    /// Where Unity and Surefoot mean the same. Both measure in metres with y up, and characters that are not rotated face +z. Unity is
    /// left-handed, with +x to the right of such a character, and rotations about y in degrees that grow clockwise seen from above. Surefoot is
    /// right-handed, with +x to its left, and yaw in radians that grows counter-clockwise. So x and angles change their signs, as importers of
    /// glTF do it. Places shift as well: maps begin at 0 along each axis, wherever the level that they were imported from has its origin.
    /// </summary>
    public struct UnityFrame
    {
        private const float DegreesPerRadian = (float)(180 / Math.PI);

        /// <summary>
        /// Where the level's own origin lies on the map, m: <see cref="Map.Origin"/>. Zeros for levels that `surefoot map export` wrote, and
        /// without a graph.
        /// </summary>
        public readonly Vec3 Origin;

        public UnityFrame(Vec3 origin)
        {
            Origin = origin;
        }

        /// <summary>The place on the map of a place in Unity.</summary>
        public Vec3 ToMap(Vec3 place) => Mirror(place) + Origin;

        /// <summary>The place in Unity of a place on the map.</summary>
        public Vec3 FromMap(Vec3 place) => Mirror(place - Origin);

        /// <summary>Converts a velocity or direction between the frames; the function is its own inverse.</summary>
        public static Vec3 Mirror(Vec3 vector) => new Vec3(-vector.X, vector.Y, vector.Z);

        /// <summary>The yaw, rad, of a character that Unity has rotated about y, degrees.</summary>
        public static float Yaw(float degrees) => -degrees / DegreesPerRadian;

        /// <summary>Unity's rotation about y, degrees, of a character with a yaw, rad.</summary>
        public static float Degrees(float yaw) => -yaw * DegreesPerRadian;
    }
}
