#pragma once

#include "Components/ActorComponent.h"
#include "CoreMinimal.h"
#include "SurefootLinkComponent.generated.h"

/** One move off the ground; places are relative to the link's actor. */
USTRUCT(BlueprintType)
struct SUREFOOT_API FSurefootLeap
{
    GENERATED_BODY()

    UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Surefoot")
    FString Ability;
    UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Surefoot")
    FVector TakeOff = FVector::ZeroVector;
    UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Surefoot")
    FVector Apex = FVector::ZeroVector;
    UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Surefoot")
    FVector Landing = FVector::ZeroVector;
    UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Surefoot")
    double Seconds = 0.0;
};

/** Data of an imported NavLinkProxy: the move of a character on it, for animation. */
UCLASS()
class SUREFOOT_API USurefootLinkComponent : public UActorComponent
{
    GENERATED_BODY()

public:
    /** The most demanding ability, such as jump. */
    UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Surefoot")
    FString Ability;

    /** Estimated chance that an NPC with the policy gets through, 0 to 1. */
    UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Surefoot")
    double Chance = 1.0;

    UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Surefoot")
    double Seconds = 0.0;

    /** Cost of entering the link, cm of walking: for a UNavArea of your own. */
    UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Surefoot")
    double EnteringCost = 0.0;

    UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Surefoot")
    TArray<FSurefootLeap> Leaps;
};
