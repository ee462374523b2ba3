using System;

namespace Surefoot.Tests
{
    internal static class MotionTests
    {
        private const float TickSeconds = 1f / World.TicksPerSecond;

        /// <summary>On a plane, where the game has nothing to do but to stop a fall, both must agree.</summary>
        internal static void MovesAsInTheSimulation(string square)
        {
            using (Map map = Map.Load(square))
            using (World world = new World(map))
            {
                uint npc = world.Spawn(map.Origin, 0.5f);
                world.Decide(npc, default(AgentAction));
                world.Tick();
                CharacterState seen = world.State(npc);
                float floor = seen.Feet.Y;
                CharacterMotion motion = new CharacterMotion(Body.Default) { Yaw = seen.Yaw, Velocity = seen.Velocity };
                motion.Moved(new Vec3(), true, TickSeconds);
                Vec3 feet = seen.Feet;
                Random random = new Random(11);
                for (int decision = 0; decision < 40; decision++)
                {
                    AgentAction action = RandomAction(random);
                    world.Decide(npc, action);
                    motion.Decide(action);
                    for (int tick = 0; tick < World.TicksPerDecision; tick++)
                    {
                        world.Tick();
                        feet = MoveOverPlane(motion, feet, floor);
                    }
                    seen = world.State(npc);
                    Expect.Near(feet, seen.Feet, 0.1f, $"the place after decision {decision}");
                    Expect.Near(motion.Velocity, seen.Velocity, 0.5f, $"the velocity after decision {decision}");
                    Expect.Near((float)Math.Cos(motion.Yaw - seen.Yaw), 1, 1e-4f, "the yaw");
                    // Differences of a tick on landing must not add up.
                    feet = seen.Feet;
                }
            }
        }

        internal static void JumpsTwice()
        {
            CharacterMotion motion = new CharacterMotion(Body.Default);
            motion.Moved(new Vec3(), true, TickSeconds);
            Expect.Equal(motion.Flags, StateFlags.Grounded | StateFlags.CanJump, "the flags on the ground");
            Jump(motion, true, "a jump");
            Expect.Equal(motion.Flags, StateFlags.CanJump, "the flags in the air");
            Jump(motion, true, "a second jump");
            Expect.Equal(motion.Flags, StateFlags.None, "the flags after the second jump");
            Jump(motion, false, "a third jump");
            motion.Moved(new Vec3(), true, TickSeconds);
            Jump(motion, true, "a jump after landing");
        }

        internal static void LeapsHavePhases(string square)
        {
            using (Map map = Map.Load(square))
            using (World world = new World(map))
            {
                uint npc = world.Spawn(map.Origin, 0);
                Locomotion locomotion = default(Locomotion);
                string phases = "";
                for (int decision = 0; decision < 10; decision++)
                {
                    AgentAction action = new AgentAction { Forward = 1, Jump = decision == 2 ? 1 : -1 };
                    world.Decide(npc, action);
                    for (int tick = 0; tick < World.TicksPerDecision; tick++)
                    {
                        world.Tick();
                        Ability used = decision == 2 && tick == 0 ? Ability.Jump : Ability.Walk;
                        locomotion.Advance(Body.Default, world.State(npc), action, used);
                        string phase = locomotion.Phase + "," + locomotion.Ability + " ";
                        phases += phases.EndsWith(phase) ? "" : phase;
                    }
                }
                Expect.That(phases.EndsWith("None,Walk Flight,Jump Landing,Jump None,Walk "), phases);
                Expect.Equal(locomotion.Pace, Pace.Run, "the pace");
                Expect.That(locomotion.Stride > 4, "the stride at 11 m/s");
                Expect.That(System.Math.Abs(locomotion.StepOffset) <= Body.Default.StepHeight, "the offset over steps");
            }
        }

        internal static void StepsGiveNoSpeed()
        {
            CharacterMotion motion = new CharacterMotion(Body.Default);
            motion.Moved(new Vec3(0, 6, 3), true, TickSeconds);
            Expect.That(motion.Velocity.Y < 3, "the upward speed after a step is that of a slope");
            motion.Moved(new Vec3(0, 6, 3), false, TickSeconds);
            Expect.Equal(motion.Velocity.Y, 6, "the upward speed in the air");
        }

        private static void Jump(CharacterMotion motion, bool isExpected, string what)
        {
            motion.Decide(new AgentAction { Jump = 1 });
            motion.Advance(TickSeconds);
            Expect.Equal(motion.Velocity.Y == Body.Default.JumpSpeed, isExpected, what);
            motion.Moved(new Vec3(), false, TickSeconds);
        }

        private static Vec3 MoveOverPlane(CharacterMotion motion, Vec3 feet, float floor)
        {
            motion.Advance(TickSeconds);
            Vec3 moved = feet + motion.Velocity * TickSeconds;
            bool isGrounded = moved.Y <= floor;
            Vec3 velocity = motion.Velocity;
            if (isGrounded)
            {
                moved.Y = floor;
                velocity.Y = 0;
            }
            motion.Moved(velocity, isGrounded, TickSeconds);
            return moved;
        }

        /// <summary>Walks in circles, so that the character stays on the square.</summary>
        private static AgentAction RandomAction(Random random) => new AgentAction
        {
            Forward = (float)random.NextDouble() * 1.2f - 0.6f,
            Strafe = (float)random.NextDouble() * 2 - 1,
            Turn = (float)random.NextDouble(),
            Jump = (float)random.NextDouble() * 2 - 1.4f,
        };
    }
}
