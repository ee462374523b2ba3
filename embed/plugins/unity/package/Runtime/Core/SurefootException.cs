using System;

namespace Surefoot
{
    /// <summary>A call of the library failed; the message names the argument and says what to change.</summary>
    public sealed class SurefootException : Exception
    {
        public SurefootException(Status status, string message)
            : base(message)
        {
            Status = status;
        }

        public Status Status { get; }
    }
}
