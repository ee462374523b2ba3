using System;

namespace Surefoot.Tests
{
    internal static class FrameTests
    {
        internal static void PlacesComeBack()
        {
            Random random = new Random(5);
            UnityFrame frame = new UnityFrame(new Vec3(22, 1, -7));
            for (int idx = 0; idx < 1000; idx++)
            {
                Vec3 place = new Vec3(Number(random), Number(random), Number(random));
                Expect.Near(frame.FromMap(frame.ToMap(place)), place, 1e-3f, "a place in Unity");
                Expect.Equal(UnityFrame.Mirror(UnityFrame.Mirror(place)), place, "a direction");
                float degrees = Number(random);
                Expect.Near(UnityFrame.Degrees(UnityFrame.Yaw(degrees)), degrees, 1e-3f, "a rotation");
            }
        }

        /// <summary>In Unity, what is not rotated faces +z and has +x at its right; 90 degrees turn it to +x.</summary>
        internal static void SidesAgree(string square)
        {
            Expect.Near(UnityMove(square, 0, new AgentAction { Forward = 1 }), new Vec3(0, 0, 1), 0.01f, "forward");
            Expect.Near(UnityMove(square, 0, new AgentAction { Strafe = 1 }), new Vec3(1, 0, 0), 0.01f, "to the right");
            Expect.Near(UnityMove(square, 90, new AgentAction { Forward = 1 }), new Vec3(1, 0, 0), 0.01f, "forward, turned by 90 degrees");
            Expect.Near(UnityMove(square, 90, new AgentAction { Strafe = 1 }), new Vec3(0, 0, -1), 0.01f, "to the right of +x");
            Expect.That(UnityTurn(square, new AgentAction { Turn = 1 }) < -10, "a turn to the left lowers Unity's angle");
        }

        internal static void OriginShifts(string square)
        {
            using (Map map = Map.Load(square))
            using (World world = new World(map))
            {
                UnityFrame frame = new UnityFrame(map.Origin);
                Expect.That(map.Origin.X >= 20 && map.Origin.Z >= 20, "the middle of the square is not at the map's corner");
                // The square is 40 m wide around its origin: a ray that falls on it meets it, one beyond its edge does not.
                Expect.Equal(Below(world, frame.ToMap(new Vec3(19, 5, -19))), Surface.Ground, "what is below a corner");
                Expect.Equal(Below(world, frame.ToMap(new Vec3(21, 5, 0))), Surface.None, "what is below a place outside");
            }
        }

        private static Surface Below(World world, Vec3 place)
        {
            SightHit[] hits = new SightHit[1];
            world.CastRays(new[] { new SightRay { Origin = place, Direction = new Vec3(0, -1, 0) } }, hits);
            return hits[0].Surface;
        }

        /// <summary>The direction, in Unity, in which the simulation moves a character that Unity has rotated.</summary>
        private static Vec3 UnityMove(string square, float degrees, AgentAction action)
        {
            CharacterState state = After(square, degrees, action);
            Vec3 moved = UnityFrame.Mirror(state.Velocity);
            moved.Y = 0;
            return moved * (1 / moved.Length);
        }

        private static float UnityTurn(string square, AgentAction action) => UnityFrame.Degrees(After(square, 0, action).Yaw);

        private static CharacterState After(string square, float degrees, AgentAction action)
        {
            using (Map map = Map.Load(square))
            using (World world = new World(map))
            {
                uint npc = world.Spawn(map.Origin, UnityFrame.Yaw(degrees));
                world.SetGoal(npc, map.Origin + new Vec3(5, 0, 5));
                world.Step(new[] { npc }, new[] { action }, new Outcome[1]);
                return world.State(npc);
            }
        }

        private static float Number(Random random) => (float)(random.NextDouble() * 2000 - 1000);
    }
}
