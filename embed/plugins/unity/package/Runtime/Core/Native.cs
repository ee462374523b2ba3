using System;
using System.Runtime.InteropServices;
using System.Text;

namespace Surefoot
{
    /// <summary>Where the library writes why a call failed; <c>sf_error</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal unsafe struct NativeError
    {
        internal const int MessageSize = 256;

        public Status Code;
        public fixed byte Message[MessageSize];
    }

    /// <summary><c>sf_query</c>, whose list of legs to avoid the caller of <see cref="Graph.FindPath(in PathQuery, ReadOnlySpan{LegKey})"/> gives apart.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal unsafe struct NativeQuery
    {
        public uint StructSize;
        public Abilities Without;
        public Vec3 Start;
        public Vec3 Goal;
        public float Caution;
        public uint AvoidCount;
        public LegKey* Avoid;
    }

    /// <summary><c>sf_ability_info</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal unsafe struct NativeAbilityInfo
    {
        internal const int NameSize = 36;
        internal const int AnimationSize = 132;

        public uint StructSize;
        public fixed byte Name[NameSize];
        public fixed byte Animation[AnimationSize];
    }

    /// <summary>A call that fills an array, and says how much room it needs.</summary>
    internal unsafe delegate Status Fill(void* items, UIntPtr capacity, UIntPtr* count, NativeError* error);

    /// <summary>What all calls share: errors, texts, sizes and arrays.</summary>
    internal static unsafe class Native
    {
        /// <summary>Throws what the library wrote, unless it says that all is well.</summary>
        internal static void Check(Status status, NativeError* error)
        {
            if (status != Status.Ok)
            {
                throw new SurefootException(status, Text(error->Message, NativeError.MessageSize));
            }
        }

        /// <summary>Throws unless a span has as many elements as the others of a call imply.</summary>
        internal static void CheckLength(string name, int length, int needed)
        {
            if (length != needed)
            {
                throw new SurefootException(Status.InvalidArgument, $"{name} has {length} elements, but this call needs {needed}");
            }
        }

        /// <summary>Throws if a text or an object is missing.</summary>
        internal static void CheckGiven(string name, object value)
        {
            if (value == null)
            {
                throw new SurefootException(Status.InvalidArgument, $"{name} is null, but must be given");
            }
        }

        /// <summary>The numbers of agents of a call: none stand for 0, 1, 2 and so on.</summary>
        internal static void CheckIds(ReadOnlySpan<uint> ids, int count)
        {
            if (!ids.IsEmpty)
            {
                CheckLength("ids", ids.Length, count);
            }
        }

        internal static UIntPtr Size(int length) => (UIntPtr)(uint)length;

        /// <summary>A text as the library reads it: UTF-8 that ends with a zero.</summary>
        internal static byte[] Utf8(string name, string text)
        {
            CheckGiven(name, text);
            return Encoding.UTF8.GetBytes(text + "\0");
        }

        /// <summary>All that a call has to give.</summary>
        internal static T[] All<T>(Fill fill)
            where T : struct
        {
            NativeError error;
            UIntPtr count = UIntPtr.Zero;
            Status status = fill(null, UIntPtr.Zero, &count, &error);
            // The number may grow between two calls if another thread changes what is copied.
            while (status == Status.BufferTooSmall)
            {
                T[] items = new T[(int)count];
                fixed (byte* first = &MemoryMarshal.GetReference(MemoryMarshal.AsBytes(items.AsSpan())))
                {
                    status = fill(first, count, &count, &error);
                }
                if (status == Status.Ok)
                {
                    Array.Resize(ref items, (int)count);
                    return items;
                }
            }
            Check(status, &error);
            return new T[0];
        }

        internal static string Text(byte* bytes, int capacity)
        {
            int length = 0;
            while (length < capacity && bytes[length] != 0)
            {
                length++;
            }
            return Encoding.UTF8.GetString(bytes, length);
        }
    }
}
