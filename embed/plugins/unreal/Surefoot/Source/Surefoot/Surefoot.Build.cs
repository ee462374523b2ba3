using System.IO;
using UnrealBuildTool;

public class Surefoot : ModuleRules
{
    public Surefoot(ReadOnlyTargetRules Target) : base(Target)
    {
        PCHUsage = PCHUsageMode.UseExplicitOrSharedPCHs;
        PublicDependencyModuleNames.AddRange(new[] { "Core", "CoreUObject", "Engine" });
        PrivateDependencyModuleNames.Add("Projects");

        string Native = Path.Combine(PluginDirectory, "Source", "ThirdParty", "libsurefoot");
        PublicIncludePaths.Add(RequireFolder(Path.Combine(Native, "include"), "surefoot.h", "from embed/capi/include"));
        AddLibrary(Path.Combine(Native, "lib"));
    }

    private void AddLibrary(string Folder)
    {
        const string Origin = "from target/release, after cargo build --release -p surefoot-capi";
        if (Target.Platform == UnrealTargetPlatform.Win64)
        {
            RequireFolder(Folder, "surefoot.dll.lib", Origin);
            RequireFolder(Folder, "surefoot.dll", Origin);
            PublicAdditionalLibraries.Add(Path.Combine(Folder, "surefoot.dll.lib"));
            PublicDelayLoadDLLs.Add("surefoot.dll");
            RuntimeDependencies.Add(Path.Combine(Folder, "surefoot.dll"));
            return;
        }
        string Name = Target.Platform == UnrealTargetPlatform.Mac ? "libsurefoot.dylib" : "libsurefoot.so";
        RequireFolder(Folder, Name, Origin);
        PublicAdditionalLibraries.Add(Path.Combine(Folder, Name));
        PublicRuntimeLibraryPaths.Add(Folder);
        RuntimeDependencies.Add(Path.Combine(Folder, Name));
    }

    // A file that is missing should be named here, and not by the linker.
    private static string RequireFolder(string Folder, string Name, string Origin)
    {
        if (!File.Exists(Path.Combine(Folder, Name)))
        {
            throw new BuildException("Surefoot: {0} is missing in {1}: copy it there {2}", Name, Folder, Origin);
        }
        return Folder;
    }
}
