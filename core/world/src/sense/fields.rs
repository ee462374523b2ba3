//! The state vector: one table of its values, from which the writer, the mirror, readers and documents follow.

use super::{LastDecision, SenseContext};
use crate::character::{Body, RawCharacterProfile};
use crate::map::{DEVICE_RANGE_M, DeviceKind};
use crate::{Episode, Vec3};

/// Greatest number of jumps in the air that an observation tells apart.
const MAX_AIR_JUMPS: u8 = 4;

/// One value of the state vector.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// Name in snake case.
    pub name: &'static str,
    /// The quantity and its unit.
    pub meaning: &'static str,
    /// The quantity at which the value is 1.
    pub scale: f32,
    /// Largest magnitude of the value.
    pub limit: f32,
    /// Whether the value changes its sign when an observation is mirrored left to right.
    pub flips: bool,
    of: fn(&Senses<'_>) -> f32,
}

impl Field {
    const fn within(self, limit: f32) -> Self {
        Self { limit, ..self }
    }

    const fn flipped(self) -> Self {
        Self { flips: true, ..self }
    }

    fn write(&self, senses: &Senses<'_>) -> f32 {
        ((self.of)(senses) / self.scale).min(self.limit).max(-self.limit)
    }
}

const fn field(name: &'static str, meaning: &'static str, scale: f32, of: fn(&Senses<'_>) -> f32) -> Field {
    Field { name, meaning, scale, limit: f32::INFINITY, flips: false, of }
}

const SPEED: f32 = 12.0;
const USUAL_SLOPE: f32 = 35.0_f32.to_radians();

/// The state vector. Vectors are in the body's frame: x to the right, y up, z ahead. The values from `body_height` on
/// compare the body with the paper's, for which they are all 0.
pub const FIELDS: [Field; 49] = [
    field("goal_distance", "distance to the goal, m", 50.0, |it| it.goal.length()).within(4.0),
    field("goal_x", "unit direction to the goal", 1.0, |it| it.goal_direction.x).flipped(),
    field("goal_y", "unit direction to the goal", 1.0, |it| it.goal_direction.y),
    field("goal_z", "unit direction to the goal", 1.0, |it| it.goal_direction.z),
    field("goal_run", "horizontal distance to the goal, m", 8.0, |it| run(it.goal)).within(1.5),
    field("goal_rise", "height of the goal above the feet, m", 8.0, |it| it.goal.y).within(1.5),
    field("velocity_x", "velocity, m/s", SPEED, |it| it.velocity.x).flipped(),
    field("velocity_y", "velocity, m/s", SPEED, |it| it.velocity.y),
    field("velocity_z", "velocity, m/s", SPEED, |it| it.velocity.z),
    field("change_x", "change of velocity since the last decision, m/s", SPEED, |it| it.change.x).flipped(),
    field("change_y", "change of velocity since the last decision, m/s", SPEED, |it| it.change.y),
    field("change_z", "change of velocity since the last decision, m/s", SPEED, |it| it.change.z),
    field("last_forward", "last action", 1.0, |it| it.last.action[0]),
    field("last_strafe", "last action", 1.0, |it| it.last.action[1]).flipped(),
    field("last_turn", "last action", 1.0, |it| it.last.action[2]).flipped(),
    field("last_jump", "last action", 1.0, |it| it.last.action[3]),
    field("is_grounded", "1 if the body stands on walkable ground", 1.0, |it| flag(it.body.is_grounded())),
    field("can_jump", "1 if the body can jump, or jump again", 1.0, |it| flag(it.body.can_jump(it.context.profile))),
    field("patience_used", "share of the patience used", 1.0, |it| it.episode.patience_used(it.context.task)),
    field("breath_used", "share of the breath used", 1.0, |it| it.breath_used()).within(1.0),
    field("pad_x", "unit direction to the nearest jump pad", 1.0, |it| it.pad.direction.x).flipped(),
    field("pad_y", "unit direction to the nearest jump pad", 1.0, |it| it.pad.direction.y),
    field("pad_z", "unit direction to the nearest jump pad", 1.0, |it| it.pad.direction.z),
    field("pad_proximity", "1 - distance / 50 m of the nearest jump pad", 1.0, |it| it.pad.proximity),
    field("entrance_x", "unit direction to the best transport's entrance", 1.0, |it| it.entrance.direction.x).flipped(),
    field("entrance_y", "unit direction to the best transport's entrance", 1.0, |it| it.entrance.direction.y),
    field("entrance_z", "unit direction to the best transport's entrance", 1.0, |it| it.entrance.direction.z),
    field("entrance_proximity", "1 - distance / 50 m of that entrance", 1.0, |it| it.entrance.proximity),
    field("exit_proximity", "1 - distance / 50 m of its exit from the goal", 1.0, |it| it.exit_proximity),
    field("jetpack_x", "unit direction to the nearest jetpack", 1.0, |it| it.jetpack.direction.x).flipped(),
    field("jetpack_y", "unit direction to the nearest jetpack", 1.0, |it| it.jetpack.direction.y),
    field("jetpack_z", "unit direction to the nearest jetpack", 1.0, |it| it.jetpack.direction.z),
    field("jetpack_proximity", "1 - distance / 50 m of the nearest jetpack", 1.0, |it| it.jetpack.proximity),
    field("fuel", "jetpack fuel, s", 5.0, |it| it.body.fuel).within(1.0),
    field("is_on_zip_line", "1 if the body rides a zip line", 1.0, |it| flag(it.body.ride.is_some())),
    field("body_height", "logarithm of the ratio of heights", 1.0, |it| it.ratio(|body| body.height)),
    field("body_radius", "logarithm of the ratio of radii", 1.0, |it| it.ratio(|body| body.radius)),
    field("body_forward_speed", "logarithm of the ratio of speeds", 1.0, |it| it.ratio(|body| body.forward_speed)),
    field("body_side_speed", "difference of the sideways share", 1.0, |it| it.difference(|body| body.side_speed_share)),
    field("body_turn_speed", "logarithm of the ratio of turning speeds", 1.0, |it| it.ratio(|body| body.turn_speed)),
    field("body_jump_height", "difference of the first jump's height, m", 2.5, |it| {
        it.difference(RawCharacterProfile::jump_height)
    })
    .within(4.0),
    field("body_gravity", "logarithm of the ratio of gravities", 1.0, |it| it.ratio(|body| body.gravity)),
    field("body_air_jumps", "difference of the jumps in the air", 1.0, |it| it.difference(air_jumps)),
    field("body_max_slope", "difference of the steepest slope, rad", USUAL_SLOPE, |it| {
        it.difference(|body| body.max_slope)
    }),
    field("body_step_height", "difference of the highest step, m", 0.3, |it| it.difference(|body| body.step_height)),
    field("body_ground_acceleration", "logarithm of the ratio of accelerations on the ground", 1.0, |it| {
        it.ratio(|body| body.ground_acceleration)
    }),
    field("body_air_acceleration", "difference of the acceleration in the air, m/s2", 25.0, |it| {
        it.difference(|body| body.air_acceleration)
    })
    .within(4.0),
    field("body_lacks_zip_lines", "-1 if the body cannot use zip lines", 1.0, |it| {
        if it.context.profile.uses_zip_lines { 0.0 } else { -1.0 }
    }),
    field("body_lacks_jetpacks", "-1 if the body cannot use jetpacks", 1.0, |it| {
        if it.context.profile.uses_jetpacks { 0.0 } else { -1.0 }
    }),
];

/// Index in the state vector of the value with this name, for use in constants.
///
/// # Panics
/// If there is no such value.
pub const fn field_idx(name: &str) -> usize {
    let mut idx = 0;
    while idx < FIELDS.len() {
        if is_same(FIELDS[idx].name.as_bytes(), name.as_bytes()) {
            return idx;
        }
        idx += 1;
    }
    panic!("no value of the state vector has this name")
}

const fn is_same(one: &[u8], other: &[u8]) -> bool {
    let mut idx = 0;
    while idx < one.len() && idx < other.len() && one[idx] == other[idx] {
        idx += 1;
    }
    idx == one.len() && idx == other.len()
}

/// The facts that the state vector is computed from.
struct Senses<'a> {
    context: SenseContext<'a>,
    body: &'a Body,
    episode: &'a Episode,
    last: &'a LastDecision,
    of_paper: RawCharacterProfile,
    /// The goal from the feet, m.
    goal: Vec3,
    goal_direction: Vec3,
    velocity: Vec3,
    change: Vec3,
    pad: Bearing,
    entrance: Bearing,
    exit_proximity: f32,
    jetpack: Bearing,
}

/// Direction and proximity of a place; zeros if there is none.
#[derive(Default)]
struct Bearing {
    direction: Vec3,
    proximity: f32,
}

impl Bearing {
    fn of(body: &Body, place: Vec3) -> Self {
        let local = body.to_local(place - body.feet);
        let distance = local.length();
        Self { direction: local / distance.max(1.0e-3), proximity: proximity(distance) }
    }
}

impl<'a> Senses<'a> {
    fn new(context: SenseContext<'a>, body: &'a Body, episode: &'a Episode, last: &'a LastDecision) -> Self {
        let goal = body.to_local(episode.goal - body.feet);
        let bearing = |place: Option<Vec3>| place.map_or_else(Bearing::default, |place| Bearing::of(body, place));
        let nearest = |kind| context.placed.nearest(kind, body.feet).map(|device| device.from);
        let transport = context.placed.best_transport(body.feet, episode.goal);
        Self {
            context,
            body,
            episode,
            last,
            of_paper: RawCharacterProfile::of_paper(),
            goal,
            goal_direction: goal / goal.length().max(1.0e-3),
            velocity: body.to_local(body.velocity),
            change: body.to_local(body.velocity - last.velocity),
            pad: bearing(nearest(DeviceKind::Pad)),
            entrance: bearing(transport.map(|(entrance, _)| entrance)),
            exit_proximity: transport.map_or(0.0, |(_, exit)| proximity(exit.distance(episode.goal))),
            jetpack: bearing(nearest(DeviceKind::Jetpack)),
        }
    }

    fn breath_used(&self) -> f32 {
        self.last.ticks_in_water as f32 / self.context.task.drown_ticks as f32
    }

    /// Logarithm of the ratio of a quantity between this body and the paper's.
    fn ratio(&self, of: fn(&RawCharacterProfile) -> f32) -> f32 {
        libm::logf(of(self.context.profile) / of(&self.of_paper))
    }

    /// Difference of a quantity between this body and the paper's.
    fn difference(&self, of: fn(&RawCharacterProfile) -> f32) -> f32 {
        of(self.context.profile) - of(&self.of_paper)
    }
}

fn proximity(distance: f32) -> f32 {
    (1.0 - distance / DEVICE_RANGE_M).max(0.0)
}

fn run(offset: Vec3) -> f32 {
    (offset.x * offset.x + offset.z * offset.z).sqrt()
}

fn flag(on: bool) -> f32 {
    if on { 1.0 } else { 0.0 }
}

fn air_jumps(profile: &RawCharacterProfile) -> f32 {
    f32::from(profile.extra_jumps.min(MAX_AIR_JUMPS))
}

/// Computes the state vector, as [`FIELDS`] lists it.
pub fn state_vector(
    context: SenseContext<'_>,
    body: &Body,
    episode: &Episode,
    last: &LastDecision,
) -> [f32; FIELDS.len()] {
    let senses = Senses::new(context, body, episode, last);
    std::array::from_fn(|idx| FIELDS[idx].write(&senses))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sense::STATE_BEGIN;

    #[test]
    fn the_documented_layout_is_that_of_the_table() {
        let page = include_str!("../../../../docs/reference/observations.md");
        for (idx, Field { name, meaning, scale, limit, flips, .. }) in (STATE_BEGIN..).zip(&FIELDS) {
            let scale = format!("{:.4}", scale).trim_end_matches('0').trim_end_matches('.').to_owned();
            let limit = if limit.is_finite() { limit.to_string() } else { String::new() };
            let flips = if *flips { "yes" } else { "" };
            let line = format!("| {idx} | `{name}` | {meaning} | {scale} | {limit} | {flips} |\n");
            assert!(page.contains(&line), "docs/reference/observations.md lacks the line\n{line}");
        }
    }

    #[test]
    fn names_are_unique() {
        for (idx, field) in FIELDS.iter().enumerate() {
            assert_eq!(field_idx(field.name), idx, "{}", field.name);
        }
    }
}
