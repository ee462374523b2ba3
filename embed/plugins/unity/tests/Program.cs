using System;
using System.Linq;

namespace Surefoot.Tests
{
    /// <summary>The files that the script `check` has made.</summary>
    internal sealed class Files
    {
        /// <summary>A generated level with a graph proved on it.</summary>
        internal string Level;
        internal string Graph;
        /// <summary>A level that is one square, with its origin in the middle.</summary>
        internal string Square;
        /// <summary>Sizes, offsets and constants of surefoot.h, by a C compiler.</summary>
        internal string Layout;
        /// <summary>Links in the format of `surefoot graph export --format unity`.</summary>
        internal string Links;
        /// <summary>What that command wrote of the level; null if the program does not know the format.</summary>
        internal string Exported;
    }

    internal static class Program
    {
        private static int failed;

        private static int Main(string[] arguments)
        {
            if (arguments.Length != 5 && arguments.Length != 6)
            {
                Console.Error.WriteLine("usage: tests LEVEL GRAPH SQUARE LAYOUT LINKS [EXPORTED]; the script `check` makes these files");
                return 1;
            }
            Files files = new Files
            {
                Level = arguments[0],
                Graph = arguments[1],
                Square = arguments[2],
                Layout = arguments[3],
                Links = arguments[4],
                Exported = arguments.ElementAtOrDefault(5),
            };
            Console.WriteLine("libsurefoot " + Library.Version);
            Run("structs and constants are those of the header", () => LayoutTests.AreThoseOfTheHeader(files.Layout));
            Run("coordinates survive the journey to the map and back", FrameTests.PlacesComeBack);
            Run("right is right and left is left in both frames", () => FrameTests.SidesAgree(files.Square));
            Run("the origin of a level shifts places", () => FrameTests.OriginShifts(files.Square));
            Run("a character moves as in the simulation", () => MotionTests.MovesAsInTheSimulation(files.Square));
            Run("a leap has a flight and a landing", () => MotionTests.LeapsHavePhases(files.Square));
            Run("a jump from the ground and one in the air", MotionTests.JumpsTwice);
            Run("a step that is climbed gives no upward speed", MotionTests.StepsGiveNoSpeed);
            Run("agents observe what the simulation observes", () => AgentsTests.ObserveWhatTheSimulationObserves(files));
            Run("64 agents decide together as each does alone", () => AgentsTests.DecideTogetherAsAlone(files));
            Run("decisions allocate nothing", () => AgentsTests.AllocateNothing(files));
            Run("policies are described and loaded", AgentsTests.PoliciesAreDescribed);
            Run("graphs are searched, closed, priced and edited", () => GraphTests.FollowsChanges(files.Graph));
            Run("alternatives avoid a leg of the cheapest plan", () => GraphTests.FindsAlternatives(files.Graph));
            Run("a snapshot brings a world back to the bit", () => AttemptTests.SnapshotRestores(files));
            Run("a follower walks plans and arrives", () => AttemptTests.WalksByPlan(files));
            Run("an agent without a graph walks straight on", () => AttemptTests.WalksStraight(files.Square));
            Run("an NPC arrives where it stands in sight of a goal", () => AttemptTests.ArrivesStanding(files.Square));
            Run("an attempt without a graph follows a goal that moves", () => AttemptTests.ChasesStraight(files.Square));
            Run("an attempt follows a goal that moves, with another plan once it has drifted", () => AttemptTests.ChasesByPlan(files));
            Run("unreachable goals and deaths end attempts", () => AttemptTests.Ends(files));
            Run("errors name what to change", () => ErrorTests.NameWhatToChange(files));
            Run("disposed and forgotten handles", () => ErrorTests.HandlesAreDestroyedOnce(files.Graph));
            Run("links are read", () => LinkFileTests.ReadsTheFormat(files.Links));
            Run("files say where the level's origin lies", LinkFileTests.ReadsOrigins);
            Run("links that the program exports are read, if it does", () => LinkFileTests.ReadsExported(files));
            Run("the reader of links is tolerant", LinkFileTests.IsTolerant);
            Run("links that are wrong are refused by name", LinkFileTests.RefusesByName);
            Console.WriteLine(failed == 0 ? "all passed" : failed + " failed");
            return failed == 0 ? 0 : 1;
        }

        private static void Run(string name, Action test)
        {
            try
            {
                test();
                Console.WriteLine("ok      " + name);
            }
            catch (Exception error)
            {
                failed++;
                Console.WriteLine("FAILED  " + name + ": " + error);
            }
        }
    }
}
