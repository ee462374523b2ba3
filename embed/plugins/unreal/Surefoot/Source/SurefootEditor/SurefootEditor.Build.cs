using UnrealBuildTool;

public class SurefootEditor : ModuleRules
{
    public SurefootEditor(ReadOnlyTargetRules Target) : base(Target)
    {
        PCHUsage = PCHUsageMode.UseExplicitOrSharedPCHs;
        PrivateDependencyModuleNames.AddRange(new[]
        {
            "Core", "CoreUObject", "Engine", "UnrealEd", "AIModule", "NavigationSystem", "Surefoot",
        });
    }
}
