#include "SurefootSubsystem.h"

#include "CollisionQueryParams.h"
#include "Components/PrimitiveComponent.h"
#include "Engine/HitResult.h"
#include "Engine/World.h"
#include "Misc/FileHelper.h"
#include "SurefootAgentComponent.h"
#include "SurefootConvert.h"
#include "SurefootLog.h"

namespace
{
sf_surface SurfaceOf(const UPrimitiveComponent* Component)
{
    struct FSurfaceTag
    {
        FName Name;
        sf_surface Surface;
    };
    static const FSurfaceTag Tags[] = {
        {TEXT("SurefootWater"), SF_SURFACE_WATER},
        {TEXT("SurefootLava"), SF_SURFACE_LAVA},
        {TEXT("SurefootPad"), SF_SURFACE_PAD},
        {TEXT("SurefootZipLine"), SF_SURFACE_ZIP_LINE},
        {TEXT("SurefootTeleporter"), SF_SURFACE_TELEPORTER},
        {TEXT("SurefootJetpack"), SF_SURFACE_JETPACK},
    };
    for (const FSurfaceTag& Tag : Tags)
    {
        if (Component && Component->ComponentHasTag(Tag.Name))
        {
            return Tag.Surface;
        }
    }
    return SF_SURFACE_GROUND;
}

/** Traces in the physics of a world, past pawns. */
class FWorldRays : public surefoot::RayBatch
{
public:
    explicit FWorldRays(const UWorld& InWorld)
        : World(InWorld)
    {
        Types.AddObjectTypesToQuery(ECC_WorldStatic);
        Types.AddObjectTypesToQuery(ECC_WorldDynamic);
    }

    virtual void trace(const surefoot::Segment* Segments, std::size_t Count, surefoot::SegmentHit* Hits) override
    {
        for (std::size_t Index = 0; Index < Count; Index++)
        {
            FHitResult Hit;
            if (World.LineTraceSingleByObjectType(Hit, ToUnreal(Segments[Index].start), ToUnreal(Segments[Index].end), Types, Query))
            {
                Hits[Index] = {Hit.Distance, SurfaceOf(Hit.GetComponent())};
            }
        }
    }

private:
    const UWorld& World;
    FCollisionObjectQueryParams Types;
    FCollisionQueryParams Query{SCENE_QUERY_STAT(SurefootRays), false};
};

constexpr const char* Policy = "general-reactive";

sf_surface KindOf(ESurefootDeviceKind Kind)
{
    switch (Kind)
    {
    case ESurefootDeviceKind::ZipLine:
        return SF_SURFACE_ZIP_LINE;
    case ESurefootDeviceKind::Teleporter:
        return SF_SURFACE_TELEPORTER;
    case ESurefootDeviceKind::Jetpack:
        return SF_SURFACE_JETPACK;
    default:
        return SF_SURFACE_PAD;
    }
}
}

bool USurefootSubsystem::DoesSupportWorldType(const EWorldType::Type WorldType) const
{
    return WorldType == EWorldType::Game || WorldType == EWorldType::PIE;
}

void USurefootSubsystem::Initialize(FSubsystemCollectionBase& Collection)
{
    Super::Initialize(Collection);
    Rays = MakeUnique<FWorldRays>(*GetWorld());
    const surefoot::Result<sf_body> Default = surefoot::default_body();
    if (!LogSurefootError(Default.error, TEXT("Surefoot")))
    {
        return;
    }
    Body = *Default.value;
    surefoot::Result<surefoot::Agents> Made = surefoot::Agents::create(Policy, Body, MaxAgents);
    if (LogSurefootError(Made.error, TEXT("Surefoot")))
    {
        Agents = MakeUnique<surefoot::Agents>(MoveTemp(*Made.value));
    }
}

bool USurefootSubsystem::LoadGraph(const FString& File, const FVector& MapCorner)
{
    TArray<uint8> Bytes;
    if (!Agents || !FFileHelper::LoadFileToArray(Bytes, *File))
    {
        UE_LOG(LogSurefoot, Error, TEXT("%s cannot be read: give the path of a graph, and package its folder as non-asset files"), *File);
        return false;
    }
    surefoot::Result<surefoot::Graph> Loaded = surefoot::Graph::load_memory(Bytes.GetData(), std::size_t(Bytes.Num()));
    if (!LogSurefootError(Loaded.error, File))
    {
        return false;
    }
    Graphs.Add(MakeUnique<surefoot::Graph>(MoveTemp(*Loaded.value)));
    Agents->set_frame(surefoot::LevelFrame(ToSurefoot(MapCorner)));
    return true;
}

bool USurefootSubsystem::LoadLevel(const FString& File)
{
    TArray<uint8> Bytes;
    if (!Agents || !FFileHelper::LoadFileToArray(Bytes, *File))
    {
        UE_LOG(LogSurefoot, Error, TEXT("%s cannot be read: give the path of a level, and package its folder as non-asset files"), *File);
        return false;
    }
    surefoot::Result<surefoot::Rehearsals> Made =
        surefoot::Rehearsals::create(Policy, Body, Bytes.GetData(), std::size_t(Bytes.Num()));
    if (!LogSurefootError(Made.error, File))
    {
        return false;
    }
    Rehearsals.Add(MakeUnique<surefoot::Rehearsals>(MoveTemp(*Made.value)));
    return true;
}

bool USurefootSubsystem::SetDevices(const TArray<FSurefootDevice>& Devices)
{
    if (!Agents)
    {
        return false;
    }
    std::vector<surefoot::Device> Known;
    for (const FSurefootDevice& Device : Devices)
    {
        Known.push_back({KindOf(Device.Kind), Device.bTwoWay, ToSurefoot(Device.From), ToSurefoot(Device.To)});
    }
    return LogSurefootError(Agents->set_devices(Known), TEXT("SetDevices"));
}

bool USurefootSubsystem::SetBlocks(const TArray<FSurefootBlock>& Blocks)
{
    if (!Agents || Rehearsals.IsEmpty())
    {
        UE_LOG(LogSurefoot, Error, TEXT("SetBlocks: no level is loaded, so that no agent rehearses: call LoadLevel first"));
        return false;
    }
    std::vector<surefoot::Block> Known;
    for (const FSurefootBlock& Block : Blocks)
    {
        Known.push_back({ToSurefoot(Block.Centre), ToSurefoot(Block.Extent), Block.Yaw});
    }
    return LogSurefootError(Rehearsals.Last()->set_blocks(Known, Agents->frame()), TEXT("SetBlocks"));
}

TOptional<uint32> USurefootSubsystem::Join(USurefootAgentComponent& Agent)
{
    int32 Free = Members.Find(nullptr);
    if (Free == INDEX_NONE)
    {
        Free = Members.Add(nullptr);
    }
    if (!Agents || uint32(Free) >= MaxAgents)
    {
        UE_LOG(LogSurefoot, Error, TEXT("%s: no room for more than %u agents, or the library was not loaded"), *Agent.GetPathName(), MaxAgents);
        return {};
    }
    Members[Free] = &Agent;
    LogSurefootError(Agents->begin(uint32(Free), uint64(uint32(Agent.Seed)) + uint64(Free)), Agent.GetPathName());
    return uint32(Free);
}

void USurefootSubsystem::Leave(USurefootAgentComponent& Agent, uint32 Number)
{
    if (Members.IsValidIndex(int32(Number)) && Members[int32(Number)] == &Agent)
    {
        Members[int32(Number)] = nullptr;
    }
}

void USurefootSubsystem::Tick(float DeltaTime)
{
    Super::Tick(DeltaTime);
    SecondsLeft -= DeltaTime;
    if (SecondsLeft > 0.0 || !Agents)
    {
        return;
    }
    // Decisions keep their rate on average, whatever the frame rate; a frame longer than a decision has one.
    SecondsLeft = FMath::Max(SecondsLeft + surefoot::Agents::decision_seconds, 0.0);
    Decide();
}

void USurefootSubsystem::Decide()
{
    Ids.Reset();
    Deciding.Reset();
    Characters.Reset();
    for (int32 Number = 0; Number < Members.Num(); Number++)
    {
        surefoot::Character Described;
        if (Members[Number] && Members[Number]->BeginDecision(Described))
        {
            Ids.Add(uint32(Number));
            Deciding.Add(Members[Number]);
            Characters.Add(Described);
        }
    }
    Controls.SetNum(Ids.Num());
    const std::size_t Count = std::size_t(Ids.Num());
    const surefoot::Error Error = Agents->decide(Ids.GetData(), Characters.GetData(), Count, *Rays, Controls.GetData());
    if (LogSurefootError(Error, TEXT("Surefoot")))
    {
        for (int32 Index = 0; Index < Deciding.Num(); Index++)
        {
            Deciding[Index]->Act(Controls[Index]);
        }
    }
    // Last, since a listener may add and remove agents.
    for (int32 Number = 0; Number < Members.Num(); Number++)
    {
        if (Members[Number])
        {
            Members[Number]->ReportEnd();
        }
    }
}

TStatId USurefootSubsystem::GetStatId() const
{
    RETURN_QUICK_DECLARE_CYCLE_STAT(USurefootSubsystem, STATGROUP_Tickables);
}
