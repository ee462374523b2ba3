using System;
using System.Runtime.InteropServices;

namespace Surefoot
{
    /// <summary>The native library as a whole.</summary>
    public static class Library
    {
        /// <summary>Version of the interface that this code was written for; <c>SF_ABI_VERSION</c>.</summary>
        public const uint AbiVersion = 1;

        private static bool isLoaded;

        /// <summary>Version of the native library, such as "0.3.0".</summary>
        public static string Version
        {
            get
            {
                RequireLoaded();
                return Marshal.PtrToStringAnsi(NativeMethods.sf_version());
            }
        }

        /// <summary>Loads the native library, and throws where that cannot be used; every class calls this first.</summary>
        public static void RequireLoaded()
        {
            if (isLoaded)
            {
                return;
            }
            uint found;
            try
            {
                found = NativeMethods.sf_abi_version();
            }
            catch (Exception error) when (error is DllNotFoundException || error is BadImageFormatException)
            {
                throw new SurefootException(
                    Status.NotFound,
                    "the native library surefoot cannot be loaded: put libsurefoot.so, libsurefoot.dylib or surefoot.dll, built for this "
                    + "processor, into Assets/Plugins (" + error.Message + ")");
            }
            if (found != AbiVersion)
            {
                throw new SurefootException(
                    Status.BadFile,
                    $"the native library has interface version {found}, but this package needs {AbiVersion}: take both from one release");
            }
            isLoaded = true;
        }
    }
}
