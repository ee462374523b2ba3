using System;
using System.Runtime.InteropServices;

namespace Surefoot
{
    /// <summary>A level, for <see cref="World"/>.</summary>
    public sealed unsafe class Map : IDisposable
    {
        private Map(MapHandle handle)
        {
            Handle = handle;
        }

        internal MapHandle Handle { get; }

        /// <summary>Reads a level: .sfmap, .glb, .gltf with embedded buffers, or .obj.</summary>
        public static Map Load(string path)
        {
            Library.RequireLoaded();
            NativeError error;
            MapHandle handle;
            fixed (byte* text = Native.Utf8(nameof(path), path))
            {
                Native.Check(NativeMethods.sf_map_load(text, out handle, &error), &error);
            }
            return new Map(handle);
        }

        /// <summary>Reads the contents of such a file.</summary>
        public static Map Load(ReadOnlySpan<byte> bytes)
        {
            Library.RequireLoaded();
            NativeError error;
            MapHandle handle;
            fixed (byte* first = &MemoryMarshal.GetReference(bytes))
            {
                Native.Check(NativeMethods.sf_map_load_memory(first, Native.Size(bytes.Length), out handle, &error), &error);
            }
            return new Map(handle);
        }

        /// <summary>The map's extent, from 0 on along each axis, m.</summary>
        public Vec3 Extent => Bounds().Item1;

        /// <summary>Where the level's own origin lies on the map, m.</summary>
        public Vec3 Origin => Bounds().Item2;

        /// <summary>The devices of the level, for <see cref="Agents.SetDevices"/>.</summary>
        public Device[] Devices() =>
            Native.All<Device>((items, capacity, count, error) => NativeMethods.sf_map_devices(Handle, (Device*)items, capacity, count, error));

        /// <summary>Worlds on the map keep what they need of it.</summary>
        public void Dispose() => Handle.Dispose();

        private (Vec3, Vec3) Bounds()
        {
            NativeError error;
            Vec3 extent;
            Vec3 origin;
            Native.Check(NativeMethods.sf_map_extent(Handle, &extent, &origin, &error), &error);
            return (extent, origin);
        }
    }
}
