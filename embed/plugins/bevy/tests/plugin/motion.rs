//! Locomotion of characters that avian moves, and of bodies that the tests move.

use crate::stage::{Ends, app_with_box};
use bevy::app::App;
use bevy::ecs::prelude::*;
use bevy::math::Vec3;
use bevy_surefoot::{
    Ability, AgentLocomotion, AgentState, Goal, Locomotion, MovePhase, Pace, SurefootAgent, SurefootCharacter,
};

fn locomotion(app: &App, agent: Entity) -> Locomotion {
    app.world().get::<AgentLocomotion>(agent).unwrap().now
}

#[test]
fn a_run_onto_a_box_has_paces_strides_and_phases_at_any_rate_of_ticks() {
    for hz in [60.0, 64.0, 30.0] {
        let mut app = app_with_box(hz);
        let agent = SurefootAgent::default();
        let place = SurefootCharacter::standing_at(Vec3::new(-6.0, 0.0, 6.0), &agent.body);
        let goal = Goal(Vec3::new(6.0, 3.0, -6.0));
        let agent = app.world_mut().spawn((agent, SurefootCharacter::default(), place, goal)).id();
        let (mut phases, mut paces, mut widest) = (vec![None], vec![Pace::Idle], 0.0_f32);
        let mut rest = 0;
        for _ in 0..3600 {
            app.update();
            let now = locomotion(&app, agent);
            phases.push(now.phase.map(|phase| (phase, now.ability)));
            paces.push(now.pace);
            widest = widest.max(now.stride_m);
            assert!((0.0..1.0).contains(&now.stride_phase));
            rest += usize::from(!app.world().resource::<Ends>().reached.is_empty());
            if rest > 60 {
                break;
            }
        }
        phases.dedup();
        let leaps: Vec<_> = phases.windows(2).filter(|pair| matches!(pair[1], Some((MovePhase::Landing, _)))).collect();
        assert!(!leaps.is_empty(), "{hz} Hz: the box is too high to walk onto: {phases:?}");
        for leap in leaps {
            let (flight, landing) = (leap[0].expect("a flight"), leap[1].expect("a landing"));
            assert_eq!((flight.0, flight.1), (MovePhase::Flight, landing.1), "{hz} Hz: {phases:?}");
        }
        let jumped = |by| phases.contains(&Some((MovePhase::Flight, by)));
        assert!(jumped(Ability::JUMP) || jumped(Ability::DOUBLE_JUMP), "{hz} Hz: {phases:?}");
        assert_eq!((phases.last(), paces.last()), (Some(&None), Some(&Pace::Idle)), "{hz} Hz: it stands at the end");
        assert!(paces.contains(&Pace::Run) && (3.0..6.0).contains(&widest), "{hz} Hz: {widest} m at 11 m/s");
    }
}

#[test]
fn an_app_says_which_ability_its_own_controller_used() {
    let mut app = app_with_box(60.0);
    let agent = app.world_mut().spawn(SurefootAgent::default()).id();
    let mut at = |height: f32, is_grounded: bool, used: Option<Ability>| {
        let state = AgentState { feet: Vec3::Y * height, is_grounded, ..AgentState::default() };
        *app.world_mut().get_mut::<AgentState>(agent).unwrap() = state;
        app.world_mut().get_mut::<AgentLocomotion>(agent).unwrap().used = used.into_iter().collect();
        app.update();
        let now = locomotion(&app, agent);
        (now.phase, now.ability)
    };
    assert_eq!(at(0.0, true, None), (None, Ability::WALK));
    assert_eq!(at(0.2, false, Some(Ability::PAD)), (Some(MovePhase::Flight), Ability::PAD));
    assert_eq!(at(0.4, false, None), (Some(MovePhase::Flight), Ability::PAD), "the plugin took what was used");
    assert_eq!(at(0.0, true, None), (Some(MovePhase::Landing), Ability::PAD));
    for _ in 0..20 {
        at(0.0, true, None);
    }
    assert_eq!(at(0.0, true, None), (None, Ability::WALK));
}
