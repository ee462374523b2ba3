#pragma once

#include "CoreMinimal.h"
#include "Subsystems/WorldSubsystem.h"
#include "SurefootAdapter.h"
#include "SurefootSubsystem.generated.h"

class USurefootAgentComponent;

/** Kinds of devices that agents sense. */
UENUM(BlueprintType)
enum class ESurefootDeviceKind : uint8
{
    JumpPad,
    /** Its entrance is at the upper end. */
    ZipLine,
    Teleporter,
    Jetpack,
};

/** A device of the level, on the ground. What it does to characters is up to the game. */
USTRUCT(BlueprintType)
struct SUREFOOT_API FSurefootDevice
{
    GENERATED_BODY()

    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Surefoot")
    ESurefootDeviceKind Kind = ESurefootDeviceKind::JumpPad;

    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Surefoot")
    FVector From = FVector::ZeroVector;

    /** Where a zip line or teleporter leads. */
    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Surefoot")
    FVector To = FVector::ZeroVector;

    /** Whether a teleporter leads back as well. */
    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Surefoot")
    bool bTwoWay = false;
};

/** An upright box that the game has put into its level, such as a crate, a barricade or a closed door. */
USTRUCT(BlueprintType)
struct SUREFOOT_API FSurefootBlock
{
    GENERATED_BODY()

    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Surefoot")
    FVector Centre = FVector::ZeroVector;

    /** Half of its size along each axis before it is turned, as the Box Extent of a box collision. */
    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Surefoot")
    FVector Extent = FVector(50.0);

    /** Rotation about z, degrees. */
    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Surefoot")
    double Yaw = 0.0;
};

/**
 * Decides for all agents of a world, six times a second, with one batch of rays.
 *
 * Rays pass through pawns. What else they hit is ground, unless its component has one of the tags SurefootWater, SurefootLava (whatever
 * kills), SurefootPad, SurefootZipLine, SurefootTeleporter and SurefootJetpack.
 */
UCLASS()
class SUREFOOT_API USurefootSubsystem : public UTickableWorldSubsystem
{
    GENERATED_BODY()

public:
    /** Most agents at once. Fixed, since agents share what is made for so many at first. */
    static constexpr uint32 MaxAgents = 256;

    /**
     * Reads a file of `surefoot graph export --format json`; attempts that begin later follow its plans. `MapCorner` is what the console
     * command Surefoot.MapCorner prints for the level that the graph was proved on, and zeros for one of `surefoot map export`.
     */
    UFUNCTION(BlueprintCallable, Category = "Surefoot")
    bool LoadGraph(const FString& File, const FVector& MapCorner);

    /**
     * Reads the level that the graph was proved on, as a .sfmap, .glb or .obj: attempts that begin later rehearse the next legs of their plans in
     * a copy of it, on a thread of the library.
     */
    UFUNCTION(BlueprintCallable, Category = "Surefoot")
    bool LoadLevel(const FString& File);

    /** Replaces the devices of the level; to be called after LoadGraph. */
    UFUNCTION(BlueprintCallable, Category = "Surefoot")
    bool SetDevices(const TArray<FSurefootDevice>& Devices);

    /**
     * Replaces the blocks that rehearsals know, at most 1024; to be called after LoadGraph and LoadLevel, whenever a block has come to rest or is
     * gone. Agents then plan again, and avoid legs on which a block stops their rehearsals.
     */
    UFUNCTION(BlueprintCallable, Category = "Surefoot")
    bool SetBlocks(const TArray<FSurefootBlock>& Blocks);

    /** Takes an agent in, and returns its number; unset, and in the log why, if there is no room. */
    TOptional<uint32> Join(USurefootAgentComponent& Agent);
    void Leave(USurefootAgentComponent& Agent, uint32 Number);

    const sf_body& GetBody() const { return Body; }
    surefoot::Agents* GetAgents() { return Agents.Get(); }
    /** Traces in the physics of the world, past pawns. */
    surefoot::RayBatch& GetRays() { return *Rays; }
    /** The graph that was loaded last; null without one. */
    const surefoot::Graph* GetGraph() const { return Graphs.IsEmpty() ? nullptr : Graphs.Last().Get(); }

    /** The rehearsals on the level that was loaded last; null without one. */
    const surefoot::Rehearsals* GetRehearsals() const { return Rehearsals.IsEmpty() ? nullptr : Rehearsals.Last().Get(); }

    virtual void Initialize(FSubsystemCollectionBase& Collection) override;
    virtual void Tick(float DeltaTime) override;
    virtual TStatId GetStatId() const override;
    virtual bool DoesSupportWorldType(const EWorldType::Type WorldType) const override;

private:
    void Decide();

    /** Agents in the order of their numbers; null where a number is free. */
    UPROPERTY()
    TArray<TObjectPtr<USurefootAgentComponent>> Members;

    sf_body Body{};
    TUniquePtr<surefoot::RayBatch> Rays;
    TUniquePtr<surefoot::Agents> Agents;
    /** Graphs outlive the attempts that follow their plans: all that were loaded stay until the world ends. */
    TArray<TUniquePtr<surefoot::Graph>> Graphs;
    TArray<TUniquePtr<surefoot::Rehearsals>> Rehearsals;
    double SecondsLeft = 0.0;

    // One element for each agent that decides, kept to spare allocations.
    TArray<uint32> Ids;
    TArray<USurefootAgentComponent*> Deciding;
    TArray<surefoot::Character> Characters;
    TArray<surefoot::Controls> Controls;
};
