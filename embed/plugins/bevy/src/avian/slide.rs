//! Kinematic motion on avian's colliders: avian's move and slide, with steep faces as walls, steps, and feet that stay
//! on the ground.

use avian3d::character_controller::move_and_slide::{
    MoveAndSlide, MoveAndSlideConfig, MoveAndSlideHitData, MoveAndSlideHitResponse, MoveHitData,
};
use avian3d::prelude::{Collider, RayHitData, SpatialQueryFilter};
use bevy_math::{Dir3, Quat, Vec3};
use std::time::Duration;
use surefoot_world::CharacterProfile;

/// Distance that bodies keep from what they touch, m; avian's own default.
const SKIN_M: f32 = 0.01;
/// Height by which a step may seem higher than it is, m.
const SLACK_M: f32 = 0.01;
/// How far beyond an edge its top is looked for, m.
const EDGE_M: f32 = 0.02;
/// How far below the feet of a body that touches a steep face the ground may be for it to stand there, m.
const FOOT_M: f32 = 0.05;
/// Share of a wish below which a body on the ground counts as stopped, and looks for a step.
const STOPPED_SHARE: f32 = 0.9;

/// A body among colliders.
pub(super) struct Slide<'a, 'w, 's> {
    pub space: &'a MoveAndSlide<'w, 's>,
    pub shape: &'a Collider,
    pub filter: &'a SpatialQueryFilter,
    pub body: &'a CharacterProfile,
}

/// Where a tick has led.
pub(super) struct Walk {
    pub centre: Vec3,
    pub is_grounded: bool,
}

/// Where a body was set down.
struct Landing {
    centre: Vec3,
    /// Height of what it touches, m.
    ground_y: f32,
}

impl Slide<'_, '_, '_> {
    /// Moves a body whose centre is at `from`, m, for a tick.
    pub fn walk(&self, from: Vec3, velocity: Vec3, was_grounded: bool, delta: Duration) -> Walk {
        let rises = velocity.y > 0.0;
        let clings = was_grounded && !rises;
        // What stands on the ground need not be pressed against it: it is set down on it afterwards.
        let velocity = if clings { velocity.with_y(0.0) } else { velocity };
        let mut centre = self.slide(from, velocity, clings, delta);
        if rises {
            return Walk { centre, is_grounded: false };
        }
        if clings {
            centre = self.climb(from, centre, velocity * delta.as_secs_f32()).unwrap_or(centre);
        }
        // Feet follow the ground as far down as they step up, and down every slope that they can walk on.
        let run = velocity.with_y(0.0).length() * delta.as_secs_f32();
        let follows = self.body.step_height.max(run * self.body.max_slope.tan());
        let reach = if clings { follows + SLACK_M } else { SLACK_M };
        match self.land(centre, reach) {
            Some(Landing { centre, .. }) => Walk { centre, is_grounded: true },
            None => Walk { centre, is_grounded: false },
        }
    }

    /// Avian's move and slide with two changes: faces that are too steep to walk on do not lift a body that runs into
    /// them, and slopes do not slow a walking body down.
    fn slide(&self, from: Vec3, velocity: Vec3, walks: bool, delta: Duration) -> Vec3 {
        let config = MoveAndSlideConfig { skin_width: SKIN_M, ..MoveAndSlideConfig::default() };
        let respond = |hit: MoveAndSlideHitData<'_>| {
            let normal = **hit.normal;
            let into = hit.velocity.dot(normal).min(0.0);
            if walks && into < 0.0 && self.is_walkable(normal) {
                hit.velocity.y -= into / normal.y;
                return MoveAndSlideHitResponse::Accept;
            }
            let slid = *hit.velocity - normal * into;
            if normal.y > 0.0 && !self.is_walkable(normal) && slid.y > hit.velocity.y.max(0.0) {
                *hit.normal = Dir3::new(normal.with_y(0.0)).unwrap_or(*hit.normal);
                // Nor does the slope in front of the face lift it.
                hit.velocity.y = if walks { hit.velocity.y.min(0.0) } else { hit.velocity.y };
            }
            MoveAndSlideHitResponse::Accept
        };
        let rotation = Quat::IDENTITY;
        self.space.move_and_slide(self.shape, from, rotation, velocity, delta, &config, self.filter, respond).position
    }

    /// Tries to step up where a body that wished to move by `wish`, m, from `from` was stopped at `stopped`.
    fn climb(&self, from: Vec3, stopped: Vec3, wish: Vec3) -> Option<Vec3> {
        let forward = Dir3::new(wish).ok()?;
        let run = (stopped - from).dot(*forward);
        if run >= STOPPED_SHARE * wish.length() || self.body.step_height <= 0.0 {
            return None;
        }
        let rise = self.free(from, Vec3::Y * (self.body.step_height + SLACK_M));
        let raised = from + Vec3::Y * rise;
        let over = raised + *forward * self.free(raised, wish);
        let Landing { centre: landed, ground_y } = self.land(over, rise)?;
        let gained = (landed - from).dot(*forward) - run;
        // What the round end of the body would slide over once it is raised is part of the step.
        let height = ground_y - (from.y - 0.5 * self.body.height);
        (gained > 1.0e-3 && height <= self.body.step_height + SLACK_M).then_some(landed)
    }

    /// How far a body can move along `motion`, m.
    fn free(&self, from: Vec3, motion: Vec3) -> f32 {
        self.cast(from, motion).map_or(motion.length(), |hit| hit.distance)
    }

    fn cast(&self, from: Vec3, motion: Vec3) -> Option<MoveHitData> {
        self.space.cast_move(self.shape, from, Quat::IDENTITY, motion, SKIN_M, self.filter)
    }

    /// Sets a body down on ground on which it can walk, at most `reach` m below; `None` if there is none.
    fn land(&self, centre: Vec3, reach: f32) -> Option<Landing> {
        let hit = self.cast(centre, Vec3::NEG_Y * reach)?;
        let centre = centre + Vec3::NEG_Y * hit.distance;
        let carries =
            self.is_walkable(hit.normal1) || self.is_edge_of_ground(centre, &hit) || self.is_over_ground(centre);
        carries.then_some(Landing { centre, ground_y: hit.point1.y })
    }

    /// Whether a body that touches an edge stands on it: the ground behind the edge is walkable and at most a step
    /// above the feet.
    fn is_edge_of_ground(&self, landed: Vec3, hit: &MoveHitData) -> bool {
        let feet = landed.y - 0.5 * self.body.height;
        if hit.point1.y - feet > self.body.step_height {
            return false;
        }
        let behind = hit.point1 - hit.normal1.with_y(0.0).normalize_or_zero() * EDGE_M;
        self.ground_below(behind + Vec3::Y * EDGE_M, 2.0 * EDGE_M).is_some()
    }

    /// Whether there is ground right below the feet: a body at the foot of a steep face may touch the face first.
    fn is_over_ground(&self, centre: Vec3) -> bool {
        let reach = 0.5 * self.body.height + FOOT_M;
        self.ground_below(centre, reach).is_some()
    }

    /// The ground on which the body can walk, at most `reach` m below a place.
    fn ground_below(&self, place: Vec3, reach: f32) -> Option<RayHitData> {
        let is_solid = |entity| self.space.colliders.contains(entity);
        let space = &self.space.spatial_query;
        let hit = space.cast_ray_predicate(place, Dir3::NEG_Y, reach, false, self.filter, &is_solid);
        hit.filter(|hit| hit.distance > 0.0 && self.is_walkable(hit.normal))
    }

    fn is_walkable(&self, normal: Vec3) -> bool {
        normal.y >= self.body.max_slope.cos() - 1.0e-3
    }
}
