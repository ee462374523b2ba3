namespace Surefoot.Editor
{
    /// <summary>Where the origin of a level lies on the map that Surefoot imports of it.</summary>
    internal static class LevelOrigin
    {
        internal static Vec3 Of(string path)
        {
            using (Map map = Map.Load(path))
            {
                return map.Origin;
            }
        }
    }
}
