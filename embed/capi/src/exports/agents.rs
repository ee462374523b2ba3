//! Policies and agents.

use super::{Handle, destroy, export, profile};
use crate::abi::{self, RAY_COUNT};
use crate::agents::{Agents, Policy, Sensed};
use crate::error::{Fault, Status};
use crate::locomotion;
use crate::memory::{
    self, fill, growing, growing_at, hand_out, lock, reference, slice, slice_mut, write, write_growing,
};
use std::ffi::{c_char, c_void};
use std::path::Path;
use std::sync::Mutex;
use surefoot_world::TaskConfig;
use surefoot_world::arrival::LINE_COUNT;
use surefoot_world::sense::RAY_RANGE_M;

destroy!(sf_policy_destroy Policy, sf_agents_destroy Handle<Agents>);

export! {
    fn sf_policy_shipped(name: *const c_char, policy: *mut *mut Policy) {
        let name = if name.is_null() { "general-reactive" } else { memory::text(name, "name")? };
        hand_out(policy, "policy", Policy::shipped(name)?)
    }

    fn sf_policy_load(path: *const c_char, policy: *mut *mut Policy) {
        let folder = Path::new(memory::text(path, "path")?);
        hand_out(policy, "policy", Policy::load(folder)?)
    }

    fn sf_policy_load_memory(
        manifest: *const c_void,
        manifest_size: usize,
        weights: *const c_void,
        weights_size: usize,
        policy: *mut *mut Policy,
    ) {
        let manifest = slice(manifest.cast::<u8>(), manifest_size, "manifest")?;
        let weights = slice(weights.cast::<u8>(), weights_size, "weights")?;
        hand_out(policy, "policy", Policy::decode(manifest, weights)?)
    }

    fn sf_policy_lengths(policy: *const Policy, observation_length: *mut usize, memory_length: *mut usize) {
        let policy = &reference(policy, "policy")?.inner;
        write(observation_length, "observation_length", policy.observation_len())?;
        write(memory_length, "memory_length", policy.memory_len())
    }

    fn sf_policy_label(policy: *const Policy, label: *mut c_char, capacity: usize, length: *mut usize) {
        let text = &reference(policy, "policy")?.label;
        let bytes: Vec<c_char> = text.bytes().chain([0]).map(|byte| byte as c_char).collect();
        fill(label, capacity, length, "label", &bytes)
    }

    fn sf_agents_create(
        policy: *const Policy,
        body: *const abi::Body,
        max_agents: u32,
        agents: *mut *mut Handle<Agents>,
    ) {
        let made = Agents::new(reference(policy, "policy")?, profile(body)?, max_agents)?;
        hand_out(agents, "agents", Mutex::new(made))
    }

    fn sf_agents_set_devices(agents: *mut Handle<Agents>, devices: *const abi::Device, count: usize) {
        let devices = slice(devices, count, "devices")?;
        lock(reference(agents, "agents")?, "agents")?.set_devices(devices)
    }

    fn sf_agents_begin(agents: *mut Handle<Agents>, agent: u32, seed: u64) {
        lock(reference(agents, "agents")?, "agents")?.begin(agent, seed)
    }

    fn sf_agents_set_goal(agents: *mut Handle<Agents>, agent: u32, feet: abi::Vec3, goal: abi::Vec3) {
        let (feet, goal) = (feet.checked("feet")?, goal.checked("goal")?);
        lock(reference(agents, "agents")?, "agents")?.set_goal(agent, feet, goal)
    }

    fn sf_agents_note(agents: *mut Handle<Agents>, agent: u32, feet: abi::Vec3, reached: *mut i32) {
        let feet = feet.checked("feet")?;
        let has_reached = lock(reference(agents, "agents")?, "agents")?.note(agent, feet)?;
        if reached.is_null() { Ok(()) } else { write(reached, "reached", has_reached.into()) }
    }

    fn sf_agents_rays(
        agents: *const Handle<Agents>,
        states: *const abi::State,
        count: usize,
        rays: *mut abi::Ray,
        ray_capacity: usize,
    ) {
        let agents = lock(reference(agents, "agents")?, "agents")?;
        let rays = slice_mut(rays, ray_capacity, "rays")?;
        if rays.len() / RAY_COUNT < count {
            let message = format!("rays has room for {ray_capacity}, but {count} agents have {RAY_COUNT} each");
            return Err(Fault::new(Status::BufferTooSmall, message));
        }
        for (idx, rays) in rays.chunks_exact_mut(RAY_COUNT).take(count).enumerate() {
            agents.rays_of(&sensed(states, idx, &agents)?, rays);
        }
        Ok(())
    }

    fn sf_locomotion_advance(
        locomotion: *mut abi::Locomotion,
        body: *const abi::Body,
        state: *const abi::State,
        action: *const abi::Action,
        ability: i32,
    ) {
        let (before, profile) = (growing(locomotion, "locomotion")?, profile(body)?);
        let sensed = Sensed::new(&growing(state, "state")?, &[], TaskConfig::default().drown_ticks)?;
        let action = (*reference(action, "action")?).try_into()?;
        let after = locomotion::advance(&before, &profile, &sensed, action, ability)?;
        write_growing(locomotion, "locomotion", after)
    }

    fn sf_agents_arrival_rays(
        agents: *const Handle<Agents>,
        state: *const abi::State,
        goal: abi::Vec3,
        radius: f32,
        rays: *mut abi::Ray,
        capacity: usize,
        count: *mut usize,
    ) {
        let agents = lock(reference(agents, "agents")?, "agents")?;
        let (goal, radius) = (goal.checked("goal")?, arrival_radius(radius)?);
        let found = agents.arrival_rays(&sensed(state, 0, &agents)?, goal, radius);
        fill(rays, capacity, count, "rays", found.as_ref().map_or(&[], |rays| rays))
    }

    fn sf_agents_has_arrived(
        agents: *const Handle<Agents>,
        state: *const abi::State,
        goal: abi::Vec3,
        radius: f32,
        hits: *const abi::Hit,
        arrived: *mut i32,
    ) {
        let agents = lock(reference(agents, "agents")?, "agents")?;
        let (goal, radius) = (goal.checked("goal")?, arrival_radius(radius)?);
        let hits = if hits.is_null() { &[] } else { slice(hits, LINE_COUNT, "hits")? };
        let has_arrived = agents.has_arrived(&sensed(state, 0, &agents)?, goal, radius, hits)?;
        write(arrived, "arrived", has_arrived.into())
    }

    fn sf_agents_observe(
        agents: *mut Handle<Agents>,
        ids: *const u32,
        states: *const abi::State,
        hits: *const abi::Hit,
        count: usize,
    ) {
        let mut agents = lock(reference(agents, "agents")?, "agents")?;
        let ids = Ids::new(ids, count, &agents)?;
        let hits = slice(hits, count.saturating_mul(RAY_COUNT), "hits")?;
        for ((idx, agent), hits) in ids.iter().enumerate().zip(hits.chunks_exact(RAY_COUNT)) {
            let sensed = sensed(states, idx, &agents)?;
            agents.observe(agent, &sensed, hits)?;
        }
        Ok(())
    }

    fn sf_agents_observe_with(
        agents: *mut Handle<Agents>,
        ids: *const u32,
        states: *const abi::State,
        count: usize,
        cast_rays: Option<abi::CastRays>,
        user: *mut c_void,
    ) {
        let cast_rays = cast_rays.ok_or_else(|| Fault::argument("cast_rays is NULL"))?;
        let mut agents = lock(reference(agents, "agents")?, "agents")?;
        let ids = Ids::new(ids, count, &agents)?;
        let (mut rays, mut hits) = (std::mem::take(&mut agents.rays), std::mem::take(&mut agents.hits));
        let observed = (|| {
            for (idx, rays) in rays.chunks_exact_mut(RAY_COUNT).take(count).enumerate() {
                agents.rays_of(&sensed(states, idx, &agents)?, rays);
            }
            hits.fill(abi::Hit::default());
            cast_rays(user, rays.as_ptr(), count * RAY_COUNT, hits.as_mut_ptr());
            for ((idx, agent), hits) in ids.iter().enumerate().zip(hits.chunks_exact(RAY_COUNT)) {
                let sensed = sensed(states, idx, &agents)?;
                agents.observe(agent, &sensed, hits)?;
            }
            Ok(())
        })();
        (agents.rays, agents.hits) = (rays, hits);
        observed
    }

    fn sf_agents_observation(
        agents: *const Handle<Agents>,
        agent: u32,
        values: *mut f32,
        capacity: usize,
        count: *mut usize,
    ) {
        let agents = lock(reference(agents, "agents")?, "agents")?;
        fill(values, capacity, count, "values", agents.observation(agent)?)
    }

    fn sf_agents_decide(
        agents: *mut Handle<Agents>,
        ids: *const u32,
        count: usize,
        noise_share: f32,
        actions: *mut abi::Action,
    ) {
        let mut agents = lock(reference(agents, "agents")?, "agents")?;
        let ids = Ids::new(ids, count, &agents)?;
        agents.decide(ids.iter(), noise_share, slice_mut(actions, count, "actions")?)
    }

    fn sf_agents_acted(agents: *mut Handle<Agents>, ids: *const u32, actions: *const abi::Action, count: usize) {
        let mut agents = lock(reference(agents, "agents")?, "agents")?;
        let ids = Ids::new(ids, count, &agents)?;
        for (agent, action) in ids.iter().zip(slice(actions, count, "actions")?) {
            agents.acted(agent, (*action).try_into()?)?;
        }
        Ok(())
    }

    fn sf_agents_progress(agents: *const Handle<Agents>, agent: u32, progress: *mut abi::Progress) {
        let found = lock(reference(agents, "agents")?, "agents")?.progress(agent)?;
        write_growing(progress, "progress", found)
    }

    fn sf_agents_save(
        agents: *const Handle<Agents>,
        agent: u32,
        bytes: *mut c_void,
        capacity: usize,
        size: *mut usize,
    ) {
        let agents = lock(reference(agents, "agents")?, "agents")?;
        let needed = agents.saved_len();
        write(size, "size", needed)?;
        let bytes = slice_mut(bytes.cast::<u8>(), capacity, "bytes")?;
        let bytes = bytes.get_mut(..needed).ok_or_else(|| {
            let message = format!("bytes has room for {capacity}, but an agent takes {needed}");
            Fault::new(Status::BufferTooSmall, message)
        })?;
        agents.save(agent, bytes)
    }

    fn sf_agents_restore(agents: *mut Handle<Agents>, agent: u32, bytes: *const c_void, size: usize) {
        let mut agents = lock(reference(agents, "agents")?, "agents")?;
        let needed = agents.saved_len();
        if size != needed {
            return Err(Fault::argument(format!("size is {size}, but a saved agent of this policy has {needed} bytes")));
        }
        agents.restore(agent, slice(bytes.cast::<u8>(), size, "bytes")?)
    }
}

/// Numbers of agents; null stands for 0, 1, 2 and so on.
struct Ids<'a> {
    list: &'a [u32],
    count: usize,
}

impl<'a> Ids<'a> {
    /// # Safety
    /// As for [`slice`].
    unsafe fn new(ids: *const u32, count: usize, agents: &Agents) -> Result<Self, Fault> {
        if count > agents.count() {
            return Err(Fault::argument(format!("count is {count}, but there are {} agents", agents.count())));
        }
        // SAFETY: passed on.
        let list = if ids.is_null() { &[] } else { unsafe { slice(ids, count, "ids") }? };
        Ok(Self { list, count })
    }

    fn iter(&self) -> impl Iterator<Item = u32> + Clone {
        (0..self.count).map(|idx| self.list.get(idx).copied().unwrap_or(idx as u32))
    }
}

/// Checks the radius around a goal: rays reach no farther.
fn arrival_radius(radius: f32) -> Result<f32, Fault> {
    if (0.0..=RAY_RANGE_M).contains(&radius) {
        return Ok(radius);
    }
    Err(Fault::argument(format!("radius is {radius}, but must be 0 to {RAY_RANGE_M} m")))
}

/// State `idx` of an array.
///
/// # Safety
/// As for [`growing_at`], and `others` of the state as for [`slice`].
pub(super) unsafe fn sensed<'a>(states: *const abi::State, idx: usize, agents: &Agents) -> Result<Sensed<'a>, Fault> {
    // SAFETY: passed on.
    let state = unsafe { growing_at(states, idx, "states[]") }?;
    let count = state.other_count as usize;
    if count > abi::MAX_OTHERS {
        return Err(Fault::argument(format!(
            "state.other_count is {count}: pass the nearest {} only",
            abi::MAX_OTHERS
        )));
    }
    // SAFETY: passed on.
    let others = unsafe { slice(state.others, count, "state.others") }?;
    Sensed::new(&state, others, agents.drown_ticks())
}
