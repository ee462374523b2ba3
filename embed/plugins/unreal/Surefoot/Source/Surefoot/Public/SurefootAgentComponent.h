#pragma once

#include "Components/ActorComponent.h"
#include "CoreMinimal.h"
#include "SurefootAdapter.h"
#include "SurefootAgentComponent.generated.h"

class ACharacter;
class USurefootSubsystem;

/** How an attempt ended. */
UENUM(BlueprintType)
enum class ESurefootEnd : uint8
{
    Reached,
    /** No plan led on, the character died, or it came no closer. */
    GaveUp,
    /** No path leads to the goal, and the character is as near as it can get. */
    Unreachable,
};

/** What the legs of a character do. */
UENUM(BlueprintType)
enum class ESurefootPace : uint8
{
    Idle,
    /** It turns in place. */
    Turn,
    Walk,
    Run,
    /** It moves, but comes to rest. */
    Stop,
};

/** Phase of a leap, a ride or a fall. */
UENUM(BlueprintType)
enum class ESurefootPhase : uint8
{
    None,
    Flight,
    /** It came down within the last 0.2 s. */
    Landing,
};

/** How a character moves, for its animation blueprint. */
USTRUCT(BlueprintType)
struct FSurefootLocomotion
{
    GENERATED_BODY()

    /** What its legs do; in the air, what they did last. */
    UPROPERTY(BlueprintReadOnly, Category = "Surefoot")
    ESurefootPace Pace = ESurefootPace::Idle;

    UPROPERTY(BlueprintReadOnly, Category = "Surefoot")
    ESurefootPhase Phase = ESurefootPhase::None;

    /** The ability of its leap or ride, as in links: 0 in a fall and without a phase, 1 jump, 2 double jump. */
    UPROPERTY(BlueprintReadOnly, Category = "Surefoot")
    uint8 Ability = 0;

    /** Length of a stride, which is two steps, cm; 0 unless it moves on the ground. */
    UPROPERTY(BlueprintReadOnly, Category = "Surefoot")
    float Stride = 0.0f;

    /** Share of the stride done, 0 to 1: one foot is put down at 0, the other at 0.5. */
    UPROPERTY(BlueprintReadOnly, Category = "Surefoot")
    float StridePhase = 0.0f;

    /** Height to add to the mesh, cm, so that the character climbs steps smoothly. */
    UPROPERTY(BlueprintReadOnly, Category = "Surefoot")
    float StepOffset = 0.0f;
};

DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FSurefootAttemptEnded, ESurefootEnd, End);

/** Lets the policy move the ACharacter that owns it, along plans where the subsystem has a graph. */
UCLASS(ClassGroup = (AI), meta = (BlueprintSpawnableComponent))
class SUREFOOT_API USurefootAgentComponent : public UActorComponent
{
    GENERATED_BODY()

public:
    USurefootAgentComponent();

    /** Whether the movement component gets the speeds and jumps of the body that the policy was trained with. */
    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Surefoot")
    bool bSetsUpMovement = true;

    /** How much plans do to avoid deaths: 0 bold to 1 careful. */
    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Surefoot", meta = (ClampMin = 0, ClampMax = 1))
    float Caution = 1.0f;

    /** Decides the noise of the agent, together with its number. */
    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Surefoot")
    int32 Seed = 0;

    /** How the character moves, also without an attempt. */
    UPROPERTY(BlueprintReadOnly, Category = "Surefoot")
    FSurefootLocomotion Locomotion;

    UPROPERTY(BlueprintAssignable, Category = "Surefoot")
    FSurefootAttemptEnded OnAttemptEnded;

    /**
     * Goes to a goal on the ground. Near the present goal, the attempt goes on with the new one, so a target that moves
     * may be passed in every frame. Elsewhere another attempt begins, and the present one ends where it stands. The
     * goal is reached where the character stands within `Radius`, cm, at most 3000, and nothing solid is between.
     */
    UFUNCTION(BlueprintCallable, Category = "Surefoot")
    void GoTo(const FVector& Goal, float Radius = 100.0f);

    /** Ends the attempt, and lets the character come to a halt. */
    UFUNCTION(BlueprintCallable, Category = "Surefoot")
    void Stop();

    /** The character died: place it elsewhere, and begin another attempt. */
    UFUNCTION(BlueprintCallable, Category = "Surefoot")
    void NoteDeath();

    virtual void BeginPlay() override;
    virtual void EndPlay(const EEndPlayReason::Type Reason) override;
    virtual void TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction) override;

private:
    friend class USurefootSubsystem;

    /** Plans, and describes the character for a decision; false if it needs none. */
    bool BeginDecision(surefoot::Character& Described);
    surefoot::Character Describe() const;
    void Act(const surefoot::Controls& Decided);
    void UpdateLocomotion(const surefoot::Character& Described, float DeltaTime);
    /** Once an attempt has ended, halts and broadcasts the event. */
    void ReportEnd();
    void SetUpMovement(const sf_body& Body);
    surefoot::Vector Feet() const;

    UPROPERTY()
    TObjectPtr<ACharacter> Character;
    UPROPERTY()
    TObjectPtr<USurefootSubsystem> Subsystem;

    /** Number of the agent; unset while the subsystem has no room for it. */
    TOptional<uint32> Number;
    TOptional<surefoot::Attempt> Attempt;
    surefoot::Controls Controls;
    surefoot::Locomotion Moving;
    /** Jumps that the character had made at the last frame since it last stood. */
    int32 LastJumps = 0;
    /** Degrees per second. */
    double TurnSpeed = 0.0;
};
