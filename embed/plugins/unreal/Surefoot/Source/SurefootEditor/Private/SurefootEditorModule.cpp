// Console commands of the editor: Surefoot.ImportLinks and Surefoot.MapCorner.
#include "AI/Navigation/NavLinkDefinition.h"
#include "AI/NavigationSystemBase.h"
#include "Engine/World.h"
#include "HAL/IConsoleManager.h"
#include "Misc/FileHelper.h"
#include "Modules/ModuleManager.h"
#include "Navigation/NavLinkProxy.h"
#include "ScopedTransaction.h"
#include "SurefootConvert.h"
#include "SurefootLinkComponent.h"
#include "SurefootLinkFile.h"

DEFINE_LOG_CATEGORY_STATIC(LogSurefootEditor, Log, All);

namespace
{
ENavLinkDirection::Type DirectionOf(surefoot::LinkDirection Direction)
{
    switch (Direction)
    {
    case surefoot::LinkDirection::BothWays:
        return ENavLinkDirection::BothWays;
    case surefoot::LinkDirection::RightToLeft:
        return ENavLinkDirection::RightToLeft;
    default:
        return ENavLinkDirection::LeftToRight;
    }
}

void Describe(AActor& Proxy, const surefoot::Link& Link)
{
    USurefootLinkComponent* Component = NewObject<USurefootLinkComponent>(&Proxy, TEXT("SurefootLink"), RF_Transactional);
    Component->Ability = ToUnreal(Link.ability);
    Component->Chance = Link.chance;
    Component->Seconds = Link.seconds;
    Component->EnteringCost = Link.entering_cost;
    const FVector Origin = ToUnreal(Link.left);
    for (const surefoot::LinkLeap& Leap : Link.leaps)
    {
        FSurefootLeap& Added = Component->Leaps.AddDefaulted_GetRef();
        Added.Ability = ToUnreal(Leap.ability);
        Added.TakeOff = ToUnreal(Leap.take_off) - Origin;
        Added.Apex = ToUnreal(Leap.apex) - Origin;
        Added.Landing = ToUnreal(Leap.landing) - Origin;
        Added.Seconds = Leap.seconds;
    }
    Proxy.AddInstanceComponent(Component);
    Component->RegisterComponent();
}

/** Places a NavLinkProxy, at the left end of a link. */
bool AddLink(UWorld& World, const surefoot::Link& Link, const FVector& MapCorner)
{
    ANavLinkProxy* Proxy = World.SpawnActor<ANavLinkProxy>(ToUnreal(Link.left) + MapCorner, FRotator::ZeroRotator);
    if (!Proxy)
    {
        return false;
    }
    FNavigationLink Simple;
    Simple.Left = FVector::ZeroVector;
    Simple.Right = ToUnreal(Link.right) - ToUnreal(Link.left);
    Simple.Direction = DirectionOf(Link.direction);
    Simple.SnapRadius = float(Link.snap_radius);
    Proxy->PointLinks.Empty();
    Proxy->PointLinks.Add(Simple);
    Proxy->SetFolderPath(TEXT("Surefoot links"));
    Describe(*Proxy, Link);
    FNavigationSystem::UpdateActorData(*Proxy);
    return true;
}

/** Where Unreal sees the corner of the map that Surefoot makes of a level file. */
TOptional<FVector> MapCornerOf(const FString& Level)
{
    const surefoot::Result<surefoot::LevelFrame> Frame = surefoot::LevelFrame::of_level(ToSurefoot(Level));
    if (!Frame)
    {
        UE_LOG(LogSurefootEditor, Error, TEXT("%s: %s"), *Level, *ToUnreal(Frame.error.text));
        return {};
    }
    return ToUnreal(Frame.value->map_corner());
}

void ImportLinks(const TArray<FString>& Arguments, UWorld* World)
{
    if (!World || World->IsGameWorld() || Arguments.IsEmpty() || Arguments.Num() > 2)
    {
        UE_LOG(LogSurefootEditor, Error, TEXT("In the editor: Surefoot.ImportLinks LINKS.json [LEVEL.glb]"));
        return;
    }
    const TOptional<FVector> MapCorner = Arguments.Num() == 2 ? MapCornerOf(Arguments[1]) : TOptional<FVector>(FVector::ZeroVector);
    FString Text;
    if (!MapCorner || !FFileHelper::LoadFileToString(Text, *Arguments[0]))
    {
        UE_LOG(LogSurefootEditor, Error, TEXT("%s, or its level, cannot be read"), *Arguments[0]);
        return;
    }
    const surefoot::Result<std::vector<surefoot::Link>> Links = surefoot::parse_links(ToSurefoot(Text));
    if (!Links)
    {
        UE_LOG(LogSurefootEditor, Error, TEXT("%s: %s"), *Arguments[0], *ToUnreal(Links.error.text));
        return;
    }
    const FScopedTransaction Transaction(NSLOCTEXT("Surefoot", "ImportLinks", "Import Surefoot links"));
    int32 Count = 0;
    for (const surefoot::Link& Link : *Links.value)
    {
        Count += AddLink(*World, Link, *MapCorner) ? 1 : 0;
    }
    UE_LOG(LogSurefootEditor, Display, TEXT("%d of %d links placed"), Count, int32(Links.value->size()));
}

void PrintMapCorner(const TArray<FString>& Arguments)
{
    if (Arguments.Num() != 1)
    {
        UE_LOG(LogSurefootEditor, Error, TEXT("Surefoot.MapCorner LEVEL.glb"));
        return;
    }
    if (const TOptional<FVector> MapCorner = MapCornerOf(Arguments[0]))
    {
        UE_LOG(LogSurefootEditor, Display, TEXT("MapCorner %s"), *MapCorner->ToString());
    }
}

FAutoConsoleCommandWithWorldAndArgs ImportLinksCommand(
    TEXT("Surefoot.ImportLinks"),
    TEXT("Places a NavLinkProxy for each link of a file of `surefoot graph export --format unreal`. LINKS.json [LEVEL.glb, that they were proved on]"),
    FConsoleCommandWithWorldAndArgsDelegate::CreateStatic(&ImportLinks));

FAutoConsoleCommand MapCornerCommand(
    TEXT("Surefoot.MapCorner"),
    TEXT("Prints MapCorner for USurefootSubsystem::LoadGraph. LEVEL.glb, that the graph was proved on"),
    FConsoleCommandWithArgsDelegate::CreateStatic(&PrintMapCorner));
}

IMPLEMENT_MODULE(FDefaultModuleImpl, SurefootEditor)
