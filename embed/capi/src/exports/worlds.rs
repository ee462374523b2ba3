//! Maps and worlds.

use super::{Handle, destroy, export, profile, read};
use crate::abi::{self, RAY_COUNT};
use crate::error::{Fault, Status};
use crate::memory::{fill, hand_out, lock, reference, slice, slice_mut, write, write_growing};
use crate::worlds::{Map, Snapshot, World};
use std::ffi::{c_char, c_void};
use std::sync::Mutex;

destroy!(sf_map_destroy Map, sf_world_destroy Handle<World>, sf_snapshot_destroy Handle<Snapshot>);

export! {
    fn sf_map_load(path: *const c_char, map: *mut *mut Map) {
        hand_out(map, "map", Map::read(&read(path)?)?)
    }

    fn sf_map_load_memory(bytes: *const c_void, size: usize, map: *mut *mut Map) {
        hand_out(map, "map", Map::read(slice(bytes.cast::<u8>(), size, "bytes")?)?)
    }

    fn sf_map_extent(map: *const Map, extent: *mut abi::Vec3, origin: *mut abi::Vec3) {
        let map = reference(map, "map")?;
        write(extent, "extent", map.extent().into())?;
        write(origin, "origin", map.frame().origin.as_vec3().into())
    }

    fn sf_map_frame(map: *const Map, frame: *mut abi::Frame) {
        write(frame, "frame", reference(map, "map")?.frame().into())
    }

    fn sf_frame_to_map(frame: *const abi::Frame, place: abi::Place, on_map: *mut abi::Vec3) {
        let frame = reference(frame, "frame")?.checked()?;
        let found = abi::Vec3::from(frame.to_map(place.checked("place")?));
        write(on_map, "on_map", found.checked("place, on the map,")?.into())
    }

    fn sf_frame_to_level(frame: *const abi::Frame, place: abi::Vec3, in_level: *mut abi::Place) {
        let frame = reference(frame, "frame")?.checked()?;
        write(in_level, "in_level", frame.to_level(place.checked("place")?).into())
    }

    fn sf_map_devices(map: *const Map, devices: *mut abi::Device, capacity: usize, count: *mut usize) {
        fill(devices, capacity, count, "devices", &reference(map, "map")?.devices())
    }

    fn sf_world_create(map: *const Map, body: *const abi::Body, world: *mut *mut Handle<World>) {
        hand_out(world, "world", Mutex::new(World::new(reference(map, "map")?, profile(body)?)))
    }

    fn sf_world_spawn(world: *mut Handle<World>, feet: abi::Vec3, yaw: f32, npc: *mut u32) {
        let feet = feet.checked("feet")?;
        let mut world = lock(reference(world, "world")?, "world")?;
        reference(npc, "npc")?;
        write(npc, "npc", world.spawn(feet, yaw)?)
    }

    fn sf_world_despawn(world: *mut Handle<World>, npc: u32) {
        lock(reference(world, "world")?, "world")?.despawn(npc)
    }

    fn sf_world_set_goal(world: *mut Handle<World>, npc: u32, goal: abi::Vec3) {
        let goal = goal.checked("goal")?;
        lock(reference(world, "world")?, "world")?.set_goal(npc, goal)
    }

    fn sf_world_decide(world: *mut Handle<World>, npc: u32, action: abi::Action) {
        lock(reference(world, "world")?, "world")?.decide(npc, action.try_into()?)
    }

    fn sf_world_tick(world: *mut Handle<World>, tick: *mut u64) {
        let mut world = lock(reference(world, "world")?, "world")?;
        world.tick();
        if tick.is_null() { Ok(()) } else { write(tick, "tick", world.current_tick()) }
    }

    fn sf_world_close_decision(world: *mut Handle<World>, npc: u32, outcome: *mut abi::Outcome) {
        let mut world = lock(reference(world, "world")?, "world")?;
        reference(outcome, "outcome")?;
        write(outcome, "outcome", world.close_decision(npc)?)
    }

    fn sf_world_step(
        world: *mut Handle<World>,
        npcs: *const u32,
        actions: *const abi::Action,
        outcomes: *mut abi::Outcome,
        count: usize,
    ) {
        let mut world = lock(reference(world, "world")?, "world")?;
        let (npcs, actions) = (slice(npcs, count, "npcs")?, slice(actions, count, "actions")?);
        let actions = actions.iter().map(|action| (*action).try_into()).collect::<Result<Vec<_>, _>>()?;
        world.step(npcs, &actions, slice_mut(outcomes, count, "outcomes")?)
    }

    fn sf_world_state(world: *const Handle<World>, npc: u32, state: *mut abi::State) {
        let found = lock(reference(world, "world")?, "world")?.state(npc)?;
        write_growing(state, "state", found)
    }

    fn sf_world_look(world: *const Handle<World>, npc: u32, hits: *mut abi::Hit, capacity: usize) {
        let world = lock(reference(world, "world")?, "world")?;
        let hits = slice_mut(hits, capacity, "hits")?.get_mut(..RAY_COUNT).ok_or_else(|| {
            let message = format!("hits has room for {capacity}, but an NPC has {RAY_COUNT} rays");
            Fault::new(Status::BufferTooSmall, message)
        })?;
        world.look(npc, hits)
    }

    fn sf_world_cast_rays(world: *const Handle<World>, rays: *const abi::Ray, count: usize, hits: *mut abi::Hit) {
        let world = lock(reference(world, "world")?, "world")?;
        world.cast(slice(rays, count, "rays")?, slice_mut(hits, count, "hits")?)
    }

    fn sf_world_observation(
        world: *const Handle<World>,
        npc: u32,
        values: *mut f32,
        capacity: usize,
        count: *mut usize,
    ) {
        let row = lock(reference(world, "world")?, "world")?.observation(npc)?;
        fill(values, capacity, count, "values", &row)
    }

    fn sf_snapshot_create(snapshot: *mut *mut Handle<Snapshot>) {
        hand_out(snapshot, "snapshot", Mutex::default())
    }

    fn sf_world_save(world: *const Handle<World>, snapshot: *mut Handle<Snapshot>) {
        let world = lock(reference(world, "world")?, "world")?;
        world.save(&mut *lock(reference(snapshot, "snapshot")?, "snapshot")?);
        Ok(())
    }

    fn sf_world_restore(world: *mut Handle<World>, snapshot: *const Handle<Snapshot>) {
        let mut world = lock(reference(world, "world")?, "world")?;
        world.restore(&*lock(reference(snapshot, "snapshot")?, "snapshot")?)
    }
}
