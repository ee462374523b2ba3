//! Followers and rehearsals.

use super::agents::sensed;
use super::graphs::{Shared, view};
use super::{Handle, destroy, export, profile};
use crate::abi;
use crate::agents::{Agents, Policy};
use crate::followers::{self, Follower, Rehearsals};
use crate::graphs::{Graph, abilities, caution as checked_caution};
use crate::memory::{self, fill, growing, hand_out, lock, reference, slice, write, write_growing};
use crate::worlds::Map;
use std::ffi::c_char;
use std::sync::Mutex;

destroy!(sf_follower_destroy Handle<Follower>, sf_rehearsals_destroy Rehearsals);

export! {
    fn sf_follower_create(goal: abi::Vec3, follower: *mut *mut Handle<Follower>) {
        hand_out(follower, "follower", Mutex::new(Follower::new(goal, None)?))
    }

    fn sf_follower_create_on(
        graph: *const Shared<Graph>,
        goal: abi::Vec3,
        follower: *mut *mut Handle<Follower>,
    ) {
        let frame = view(graph)?.frame_of_places().copied();
        hand_out(follower, "follower", Mutex::new(Follower::new(goal, frame)?))
    }

    fn sf_follower_copy(from: *const Handle<Follower>, to: *mut Handle<Follower>) {
        let state = lock(reference(from, "from")?, "from")?.clone();
        *lock(reference(to, "to")?, "to")? = state;
        Ok(())
    }

    fn sf_follower_advance(follower: *mut Handle<Follower>, feet: abi::Vec3, reached: i32, step: *mut abi::Step) {
        let found = lock(reference(follower, "follower")?, "follower")?.advance(feet, reached != 0)?;
        write_growing(step, "step", found)
    }

    fn sf_follower_move_goal(
        follower: *mut Handle<Follower>,
        goal: abi::Vec3,
        feet: abi::Vec3,
        reached: i32,
        step: *mut abi::Step,
    ) {
        let found = lock(reference(follower, "follower")?, "follower")?.move_goal(goal, feet, reached != 0)?;
        write_growing(step, "step", found)
    }

    fn sf_follower_plan(
        follower: *mut Handle<Follower>,
        graph: *const Shared<Graph>,
        feet: abi::Vec3,
        caution: f32,
        without: u32,
        step: *mut abi::Step,
    ) {
        let (caution, without) = (checked_caution(caution)?, abilities(without)?);
        let graph = view(graph)?;
        let found = lock(reference(follower, "follower")?, "follower")?.plan(&graph, feet, caution, without)?;
        write_growing(step, "step", found)
    }

    fn sf_rehearsals_create(
        policy: *const Policy,
        map: *const Map,
        body: *const abi::Body,
        thread_count: u32,
        rehearsals: *mut *mut Rehearsals,
    ) {
        let (policy, map) = (reference(policy, "policy")?, reference(map, "map")?);
        hand_out(rehearsals, "rehearsals", Rehearsals::new(policy, map, profile(body)?, thread_count)?)
    }

    fn sf_rehearsals_set_blocks(rehearsals: *const Rehearsals, blocks: *const abi::Block, count: usize) {
        reference(rehearsals, "rehearsals")?.set_blocks(slice(blocks, count, "blocks")?)
    }

    fn sf_follower_prepare(
        follower: *mut Handle<Follower>,
        rehearsals: *const Rehearsals,
        agents: *mut Handle<Agents>,
        agent: u32,
        state: *const abi::State,
        origin: abi::Vec3,
        step: *mut abi::Step,
    ) {
        let origin = origin.checked("origin")?;
        let rehearsals = reference(rehearsals, "rehearsals")?;
        let mut agents = lock(reference(agents, "agents")?, "agents")?;
        let sensed = sensed(state, 0, &agents)?;
        let mut follower = lock(reference(follower, "follower")?, "follower")?;
        let found = follower.prepare(rehearsals, (&mut agents, agent), &sensed, origin)?;
        write_growing(step, "step", found)
    }

    fn sf_gait_named(name: *const c_char, gait: *mut abi::Gait) {
        let found = followers::gait_named(memory::text(name, "name")?)?;
        write(gait, "gait", found)
    }

    fn sf_follower_set_gait(follower: *mut Handle<Follower>, gait: *const abi::Gait, step: *mut abi::Step) {
        let gait = followers::gait(&growing(gait, "gait")?)?;
        let found = lock(reference(follower, "follower")?, "follower")?.set_gait(gait);
        write_growing(step, "step", found)
    }

    fn sf_follower_note_death(follower: *mut Handle<Follower>) {
        lock(reference(follower, "follower")?, "follower")?.record_death();
        Ok(())
    }

    fn sf_follower_legs(follower: *const Handle<Follower>, legs: *mut abi::Leg, capacity: usize, count: *mut usize) {
        let found = lock(reference(follower, "follower")?, "follower")?.legs()?;
        fill(legs, capacity, count, "legs", &found)
    }

    fn sf_follower_take_traversals(
        follower: *mut Handle<Follower>,
        traversals: *mut abi::Traversal,
        capacity: usize,
        count: *mut usize,
    ) {
        let mut follower = lock(reference(follower, "follower")?, "follower")?;
        fill(traversals, capacity, count, "traversals", follower.traversals())?;
        follower.forget_traversals();
        Ok(())
    }
}
