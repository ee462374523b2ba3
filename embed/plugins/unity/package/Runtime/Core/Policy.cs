using System;
using System.Runtime.InteropServices;

namespace Surefoot
{
    /// <summary>Weights that decide. A policy never changes, and any number of threads may use it.</summary>
    public sealed unsafe class Policy : IDisposable
    {
        private const int LongestLabel = 64;

        private Policy(PolicyHandle handle)
        {
            Handle = handle;
        }

        internal PolicyHandle Handle { get; }

        /// <summary>Number of values of an observation.</summary>
        public int ObservationLength => Lengths().Item1;

        /// <summary>Number of values of an agent's memory; 0 for a reactive policy.</summary>
        public int MemoryLength => Lengths().Item2;

        /// <summary>Name and shortened hash of the weights.</summary>
        public string Label
        {
            get
            {
                NativeError error;
                UIntPtr length;
                byte* label = stackalloc byte[LongestLabel];
                Native.Check(NativeMethods.sf_policy_label(Handle, label, Native.Size(LongestLabel), &length, &error), &error);
                return Native.Text(label, LongestLabel);
            }
        }

        /// <summary>A policy that is built in, "general-reactive" or "general-lstm"; null for the first.</summary>
        public static Policy Shipped(string name = null)
        {
            Library.RequireLoaded();
            NativeError error;
            PolicyHandle handle;
            fixed (byte* text = name == null ? null : Native.Utf8(nameof(name), name))
            {
                Native.Check(NativeMethods.sf_policy_shipped(text, out handle, &error), &error);
            }
            return new Policy(handle);
        }

        /// <summary>Reads a model's folder, which has manifest.json and weights.bpk.</summary>
        public static Policy Load(string folder)
        {
            Library.RequireLoaded();
            NativeError error;
            PolicyHandle handle;
            fixed (byte* text = Native.Utf8(nameof(folder), folder))
            {
                Native.Check(NativeMethods.sf_policy_load(text, out handle, &error), &error);
            }
            return new Policy(handle);
        }

        /// <summary>Decodes the contents of the two files of a model.</summary>
        public static Policy Load(ReadOnlySpan<byte> manifest, ReadOnlySpan<byte> weights)
        {
            Library.RequireLoaded();
            NativeError error;
            PolicyHandle handle;
            fixed (byte* manifestStart = &MemoryMarshal.GetReference(manifest), weightsStart = &MemoryMarshal.GetReference(weights))
            {
                Native.Check(
                    NativeMethods.sf_policy_load_memory(
                        manifestStart, Native.Size(manifest.Length), weightsStart, Native.Size(weights.Length), out handle, &error),
                    &error);
            }
            return new Policy(handle);
        }

        /// <summary>Agents that were made of the policy keep what they need of it.</summary>
        public void Dispose() => Handle.Dispose();

        private (int, int) Lengths()
        {
            NativeError error;
            UIntPtr observation;
            UIntPtr memory;
            Native.Check(NativeMethods.sf_policy_lengths(Handle, &observation, &memory, &error), &error);
            return ((int)observation, (int)memory);
        }
    }
}
