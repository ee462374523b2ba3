#include "SurefootAgentComponent.h"

#include "GameFramework/Character.h"
#include "GameFramework/CharacterMovementComponent.h"
#include "SurefootConvert.h"
#include "SurefootLog.h"
#include "SurefootSubsystem.h"

namespace
{
constexpr float CmPerMetre = 100.0f;

ESurefootEnd EndOf(surefoot::AttemptState State)
{
    switch (State)
    {
    case surefoot::AttemptState::Reached:
        return ESurefootEnd::Reached;
    case surefoot::AttemptState::Unreachable:
        return ESurefootEnd::Unreachable;
    default:
        return ESurefootEnd::GaveUp;
    }
}
}

USurefootAgentComponent::USurefootAgentComponent()
{
    PrimaryComponentTick.bCanEverTick = true;
    // Input that is added before physics moves the character in the same frame.
    PrimaryComponentTick.TickGroup = TG_PrePhysics;
}

void USurefootAgentComponent::BeginPlay()
{
    Super::BeginPlay();
    Character = Cast<ACharacter>(GetOwner());
    Subsystem = GetWorld()->GetSubsystem<USurefootSubsystem>();
    if (!Character || !Subsystem)
    {
        UE_LOG(LogSurefoot, Error, TEXT("%s: a Surefoot Agent must be a component of an ACharacter in a game"), *GetPathName());
        return;
    }
    Number = Subsystem->Join(*this);
    if (Number && bSetsUpMovement)
    {
        SetUpMovement(Subsystem->GetBody());
    }
    TurnSpeed = FMath::RadiansToDegrees(Subsystem->GetBody().turn_speed);
}

void USurefootAgentComponent::EndPlay(const EEndPlayReason::Type Reason)
{
    Attempt.Reset();
    if (Number)
    {
        Subsystem->Leave(*this, *Number);
        Number.Reset();
    }
    Super::EndPlay(Reason);
}

void USurefootAgentComponent::SetUpMovement(const sf_body& Body)
{
    UCharacterMovementComponent& Movement = *Character->GetCharacterMovement();
    Character->JumpMaxCount = 1 + int32(Body.extra_jumps);
    Character->bUseControllerRotationYaw = false;
    Movement.bOrientRotationToMovement = false;
    // An agent needs no AI controller.
    Movement.bRunPhysicsWithNoController = true;
    Movement.MaxWalkSpeed = Body.forward_speed * CmPerMetre;
    Movement.MaxAcceleration = Body.ground_acceleration * CmPerMetre;
    Movement.BrakingDecelerationWalking = Body.ground_acceleration * CmPerMetre;
    // The simulation brakes by deceleration alone.
    Movement.bUseSeparateBrakingFriction = true;
    Movement.BrakingFriction = 0.0f;
    Movement.AirControl = Body.air_acceleration / Body.ground_acceleration;
    Movement.AirControlBoostMultiplier = 0.0f;
    Movement.BrakingDecelerationFalling = Body.air_acceleration * CmPerMetre;
    Movement.FallingLateralFriction = 0.0f;
    Movement.JumpZVelocity = Body.jump_speed * CmPerMetre;
    Movement.GravityScale = -Body.gravity * CmPerMetre / GetWorld()->GetGravityZ();
    Movement.MaxStepHeight = Body.step_height * CmPerMetre;
    Movement.SetWalkableFloorAngle(FMath::RadiansToDegrees(Body.max_slope));
}

void USurefootAgentComponent::GoTo(const FVector& Goal, float Radius)
{
    if (!Number)
    {
        UE_LOG(LogSurefoot, Error, TEXT("%s: GoTo before BeginPlay, or without room for the agent: see the log above"), *GetPathName());
        return;
    }
    if (Attempt && Attempt->is_near_goal(ToSurefoot(Goal), Feet()))
    {
        Attempt->set_radius(Radius);
        LogSurefootError(Attempt->move_goal(ToSurefoot(Goal), Feet()), GetPathName());
        return;
    }
    Attempt.Reset();
    surefoot::Result<surefoot::Attempt> Begun =
        surefoot::Attempt::begin(*Subsystem->GetAgents(), *Number, Subsystem->GetGraph(), Feet(), ToSurefoot(Goal), Caution);
    if (LogSurefootError(Begun.error, GetPathName()))
    {
        Attempt.Emplace(MoveTemp(*Begun.value));
        Attempt->set_radius(Radius);
        Attempt->set_rehearsals(Subsystem->GetRehearsals());
    }
}

void USurefootAgentComponent::Stop()
{
    Attempt.Reset();
    Controls = {};
}

void USurefootAgentComponent::NoteDeath()
{
    if (Attempt)
    {
        LogSurefootError(Attempt->note_death(), GetPathName());
        ReportEnd();
    }
}

void USurefootAgentComponent::TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction)
{
    Super::TickComponent(DeltaTime, TickType, ThisTickFunction);
    if (!Number)
    {
        return;
    }
    const surefoot::Character Described = Describe();
    if (Attempt)
    {
        LogSurefootError(Attempt->note(Described, Subsystem->GetRays()), GetPathName());
    }
    UpdateLocomotion(Described, DeltaTime);
    Character->AddActorWorldRotation(FRotator(0.0, Controls.turn * TurnSpeed * DeltaTime, 0.0));
    const double SideShare = Subsystem->GetBody().side_speed_share;
    const double Forward = FMath::Max(Controls.forward, -SideShare);
    const FVector Input = Character->GetActorForwardVector() * Forward + Character->GetActorRightVector() * (Controls.right * SideShare);
    // Longer inputs are shortened by the movement component, as the simulation does it.
    Character->AddMovementInput(Input, 1.0f);
}

void USurefootAgentComponent::UpdateLocomotion(const surefoot::Character& Described, float DeltaTime)
{
    const int32 Jumps = Character->JumpCurrentCount;
    const sf_ability Used = Jumps <= LastJumps ? SF_WALK : Jumps > 1 ? SF_DOUBLE_JUMP : SF_JUMP;
    LastJumps = Jumps;
    LogSurefootError(Moving.advance(Subsystem->GetBody(), Described, Controls, DeltaTime, Used), GetPathName());
    Locomotion.Pace = ESurefootPace(Moving.pace());
    Locomotion.Phase = ESurefootPhase(Moving.phase());
    Locomotion.Ability = uint8(Moving.ability());
    Locomotion.Stride = float(Moving.stride());
    Locomotion.StridePhase = float(Moving.stride_phase());
    Locomotion.StepOffset = float(Moving.step_offset());
}

bool USurefootAgentComponent::BeginDecision(surefoot::Character& Described)
{
    Described = Describe();
    return Attempt && LogSurefootError(Attempt->advance(Described, Subsystem->GetRays()), GetPathName())
        && Attempt->state() == surefoot::AttemptState::GoesOn;
}

surefoot::Character USurefootAgentComponent::Describe() const
{
    const UCharacterMovementComponent& Movement = *Character->GetCharacterMovement();
    surefoot::Character Described;
    Described.feet = Feet();
    Described.velocity = ToSurefoot(Movement.Velocity);
    Described.yaw_degrees = Character->GetActorRotation().Yaw;
    Described.is_grounded = Movement.IsMovingOnGround();
    Described.can_jump = Character->CanJump();
    return Described;
}

void USurefootAgentComponent::Act(const surefoot::Controls& Decided)
{
    Controls = Decided;
    // A jump that is still held would hide the next one.
    Character->StopJumping();
    if (Controls.jump)
    {
        Character->Jump();
    }
}

void USurefootAgentComponent::ReportEnd()
{
    if (Attempt && Attempt->state() != surefoot::AttemptState::GoesOn)
    {
        const ESurefootEnd End = EndOf(Attempt->state());
        Stop();
        OnAttemptEnded.Broadcast(End);
    }
}

surefoot::Vector USurefootAgentComponent::Feet() const
{
    return ToSurefoot(Character->GetCharacterMovement()->GetActorFeetLocation());
}
