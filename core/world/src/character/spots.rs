//! How a body makes moves of its own at the spots of a map.

use super::action::Action;
use super::body::{Body, OwnRun, Support};
use super::own::{OwnMotion, OwnMove};
use super::profile::CharacterProfile;
use crate::ability::{Ability, AbilitySet};
use crate::float::horizontal;
use crate::map::CollisionMap;
use crate::map::features::CATCH_HEIGHT_M;
use crate::{TICK_SECONDS, Vec3};

/// Distance of the feet from the end of a way at which a body enters it, m.
const ENTER_M: f32 = 0.6;
/// Least speed at which it wants to, as a share of its top speed, and the least cosine of the angle to the way.
const LEAST_WISH: f32 = 0.2;
const LEAST_TOWARDS: f32 = 0.7;
/// Shortest way on the plane that has a direction, m.
const PLANE_M: f32 = 0.3;
/// Speed that is left after a curve, as a share.
const RELEASE_SHARE: f32 = 0.4;
/// Least height of an anchor above the feet, m.
const LEAST_ABOVE_M: f32 = 1.0;
/// Part of a ray to an anchor that may be inside something solid, m: anchors are fixed to walls.
const HIDDEN_M: f32 = 0.6;
/// Least distance of an anchor, m: jumps do what is nearer, and a body that has let go does not catch it again.
const NEAREST_M: f32 = 3.0;
/// Distance of the body's middle from the anchor at which it lets go, and how far above the anchor its feet rise then,
/// m.
const RELEASE_M: f32 = 1.0;
const ABOVE_ANCHOR_M: f32 = 0.5;
/// A body lets go as well if it has moved slower than this share of the speed of the move for so many ticks.
const HELD_SHARE: f32 = 0.2;
const HELD_TICKS: u8 = 6;

impl Body {
    /// Moves the body along the curve that it follows, if it follows one.
    pub(super) fn follow_curve(&mut self, profile: &CharacterProfile, used: &mut AbilitySet) -> bool {
        let Some((run, own)) = self.own_run(profile, OwnMotion::Curve) else { return false };
        let ends = [run.from, run.to];
        let ticks = run.ticks + 1;
        let share = (f32::from(ticks) * TICK_SECONDS / own.seconds(ends)).min(1.0);
        let feet = own.at(ends, share);
        self.velocity = (feet - self.feet) / TICK_SECONDS;
        self.feet = feet;
        self.leave_ground();
        self.jump_pending = false;
        self.own = Some(OwnRun { ticks, ..run });
        used.insert(Ability::own(run.idx.into()));
        if share >= 1.0 || ticks == u16::MAX {
            self.own = None;
            self.velocity *= RELEASE_SHARE;
            self.air_jumps_left = profile.extra_jumps;
        }
        true
    }

    /// Begins a curve whose end the body walks over, if it wants to go to the other end.
    pub(super) fn enter_spots(&mut self, map: &CollisionMap, profile: &CharacterProfile, action: &Action) {
        let is_free = self.ride.is_none() && self.own.is_none() && self.is_grounded();
        if !is_free || profile.moves.is_empty() {
            return;
        }
        let wish = self.wish(profile, action);
        if wish.length() < LEAST_WISH * profile.forward_speed {
            return;
        }
        let enters = |[from, to]: &[Vec3; 2]| {
            let way = (*to - *from).with_y(0.0);
            let is_towards = way.length() < PLANE_M || wish.normalize().dot(way.normalize()) >= LEAST_TOWARDS;
            is_towards && horizontal(self.feet - *from) <= ENTER_M && (self.feet.y - from.y).abs() <= CATCH_HEIGHT_M
        };
        let found = map.ways_at(self.feet).filter(|(_, way)| enters(way)).find_map(|(spot, way)| {
            let (ability, _) = profile.own_with(OwnMotion::Curve).find(|(_, own)| own.fits(spot))?;
            Some((ability.own_idx()?, way))
        });
        if let Some((idx, [from, to])) = found {
            self.own = Some(OwnRun { idx: idx as u8, from, to, ticks: 0, held_ticks: 0 });
        }
    }

    /// Lets the body be pulled to the nearest anchor that it sees ahead, if it can. `wish` is its wanted velocity.
    pub(super) fn catch_anchor(&mut self, map: &CollisionMap, profile: &CharacterProfile, wish: Vec3) -> bool {
        let ahead = wish.try_normalize().unwrap_or(self.facing());
        let middle = self.feet + Vec3::Y * (0.5 * profile.height);
        let in_reach = |own: &OwnMove, at: Vec3| {
            let (to, distance) = (at - middle, middle.distance(at));
            let way = to.with_y(0.0);
            distance <= own.range
                && distance > NEAREST_M
                && at.y - self.feet.y >= LEAST_ABOVE_M
                && (way.length() < PLANE_M || way.normalize().dot(ahead) >= LEAST_TOWARDS)
                && map
                    .mesh()
                    .cast_ray(middle, to / distance, distance - HIDDEN_M)
                    .is_none_or(|it| !it.surface.is_solid())
        };
        let tethers = profile.own_with(OwnMotion::Tether);
        let anchors = tethers.flat_map(|(ability, own)| {
            let spots = map.placed().spots.iter().filter(|spot| own.fits(spot));
            let places = spots.flat_map(|spot| spot.ends()).filter(move |at| in_reach(own, *at));
            places.map(move |at| (ability, at))
        });
        let nearest = anchors.min_by(|one, other| one.1.distance(middle).total_cmp(&other.1.distance(middle)));
        let Some((idx, to)) = nearest.and_then(|(ability, at)| Some((ability.own_idx()?, at))) else { return false };
        self.own = Some(OwnRun { idx: idx as u8, from: self.feet, to, ticks: 0, held_ticks: 0 });
        self.dash_ticks = 0;
        true
    }

    /// Gives a body that is pulled to an anchor its velocity, or lets it go; returns whether it is pulled.
    pub(super) fn is_pulled(&mut self, profile: &CharacterProfile, used: &mut AbilitySet) -> bool {
        let Some((run, own)) = self.own_run(profile, OwnMotion::Tether) else { return false };
        let to = run.to - (self.feet + Vec3::Y * (0.5 * profile.height));
        let is_held = run.ticks > 0 && self.velocity.length() < HELD_SHARE * own.speed;
        let held_ticks = if is_held { run.held_ticks + 1 } else { 0 };
        let lasts = f32::from(run.ticks) * TICK_SECONDS <= 2.0 * own.range / own.speed;
        used.insert(Ability::own(run.idx.into()));
        self.support = Support::Air;
        if to.length() > RELEASE_M && lasts && held_ticks < HELD_TICKS {
            self.velocity = to.normalize() * own.speed;
            self.own = Some(OwnRun { ticks: run.ticks + 1, held_ticks, ..run });
            return true;
        }
        let rise = 0.5 * profile.height + RELEASE_M + ABOVE_ANCHOR_M;
        let speed = libm::sqrtf(2.0 * profile.gravity * rise);
        self.velocity = self.velocity.with_y(0.0).clamp_length_max(profile.forward_speed) + Vec3::Y * speed;
        self.air_jumps_left = profile.extra_jumps;
        self.own = None;
        true
    }

    /// The move of its own that the body is making, if it has this motion. A profile may have lost it.
    fn own_run<'a>(&self, profile: &'a CharacterProfile, motion: OwnMotion) -> Option<(OwnRun, &'a OwnMove)> {
        let run = self.own?;
        let own = profile.moves.get(usize::from(run.idx))?;
        (own.motion == motion).then_some((run, own))
    }
}
