//! Followers.

use super::graphs::{Shared, view};
use super::{Handle, destroy, export};
use crate::abi;
use crate::followers::Follower;
use crate::graphs::{Graph, abilities, caution as checked_caution};
use crate::memory::{fill, hand_out, lock, reference, write_growing};
use std::sync::Mutex;

destroy!(sf_follower_destroy Handle<Follower>);

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
