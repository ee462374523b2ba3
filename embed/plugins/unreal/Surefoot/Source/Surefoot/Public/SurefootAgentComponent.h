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
    /** Degrees per second. */
    double TurnSpeed = 0.0;
};
