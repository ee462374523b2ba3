using System;

namespace Surefoot.Tests
{
    /// <summary>What a test expects; the first that is not so ends it.</summary>
    internal static class Expect
    {
        internal static void That(bool holds, string what)
        {
            if (!holds)
            {
                throw new Exception("not so: " + what);
            }
        }

        internal static void Equal<T>(T found, T expected, string what) => That(Equals(found, expected), $"{what} is {found}, but {expected} was expected");

        internal static void Near(Vec3 found, Vec3 expected, float distance, string what) =>
            That((found - expected).Length <= distance, $"{what} is {found}, but {expected} was expected");

        internal static void Near(float found, float expected, float difference, string what) =>
            That(Math.Abs(found - expected) <= difference, $"{what} is {found}, but {expected} was expected");

        /// <summary>An error must have its status, and its text the words that tell what to change.</summary>
        internal static void Fails(Status status, string words, Action call)
        {
            try
            {
                call();
            }
            catch (SurefootException error)
            {
                Equal(error.Status, status, $"the status of '{error.Message}'");
                That(error.Message.Contains(words), $"'{error.Message}' has the words '{words}'");
                return;
            }
            throw new Exception($"no error, but one with '{words}' was expected");
        }
    }
}
