//! Leaps over a gap, without the policy: a run-up to the rim, backwards first if the body is too near, a jump after the
//! decision from which it arrives best, and straight on from where the body lands.
//!
//! A leap knows both rims of its gap. It senses nothing, like [steering](crate::steer), and its rehearsal shows whether
//! the NPC arrives so.

use crate::steer::{BRAKE, Course, moving, turn_by};
use surefoot_world::arrival::Rims;
use surefoot_world::character::{Body, DASH_TICKS};
use surefoot_world::float::{heading, horizontal, hypot, wrapped};
use surefoot_world::{Action, CharacterProfile, DECISION_SECONDS, TICK_SECONDS, TICKS_PER_DECISION, Vec3};

/// Distance before the rim at which a body takes off, at least, m.
const RIM_M: f32 = 0.1;
/// How far a body must be past the rim when it lands, at least, m.
const BEYOND_M: f32 = 0.2;
/// How far beyond the landing the place is that a body in the air faces, m.
const FACES_M: f32 = 2.5;
/// Distance before the far rim at which the body must be above it, and by how much, m.
const TOE_M: f32 = 0.2;
const ABOVE_M: f32 = 0.1;
/// Distance before the rim up to which a body heads for the rim, and from where on it heads for the landing, m.
const ALIGN_M: f32 = 2.0;
/// Height below the far rim at which a body has not landed beyond it, m.
const BELOW_M: f32 = 0.5;
/// Angle between facing and the leap up to which a body jumps, rad.
const FACED: f32 = 0.35;
/// Distance before the rim from which on a body turns on the spot, m.
const TURN_M: f32 = 0.9;
/// Speed up to which a body that was just put on the ground is not in flight, m/s, and its height above the rim, m.
const SETTLING_SPEED: f32 = 0.6;
const SETTLING_M: f32 = 0.3;
/// Distance to the side of a leap up to which a body may take its run-up, m.
const ASIDE_M: f32 = 0.25;
/// Share of its speed with which a body goes back for a run-up.
const BACK_SHARE: f32 = 0.6;
/// Length that is added to the longest run-up, m.
const RUN_UP_SLACK_M: f32 = 0.3;
/// Most decisions of a run-up.
const RUN_UP_DECISIONS: u32 = 8;
/// Share of the reach of a round sole over a rim that a body counts on. At speed it slides off earlier.
const LIP_SHARE: f32 = 0.5;
/// Clearance above which more makes no difference, m.
const ROOMY_M: f32 = 0.3;
/// Least speed of a run-up, m/s.
const LEAST_SPEED: f32 = 2.5;
/// Places before the rim from which a leap is tried to see whether it is possible, m.
const TRIED_M: [f32; 3] = [RIM_M, 1.5, 3.0];
/// Halvings of the range of a speed or a time: to a part in 256.
const BISECTIONS: u32 = 8;
/// Decisions in the air after which a jump in the air may follow.
const AIR_JUMPS: [u32; 6] = [1, 2, 3, 4, 5, 6];

/// A leap over the gap between two rims, and the leg that it belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leap {
    /// The rims of the gap.
    pub rims: Rims,
    /// The course of the leg, which ends beyond the gap.
    pub course: Course,
}

impl Leap {
    /// The action of a body on this leap.
    pub fn action(&self, body: &Body, profile: &CharacterProfile) -> Action {
        let gap = Gap::of(&self.rims, self.course.to);
        let at = gap.along(body.feet);
        let is_beyond = at > gap.width - TOE_M && body.feet.y > self.rims.landing.y - BELOW_M;
        if is_beyond && body.is_grounded() || body.is_carried() {
            return self.course.action(body, profile);
        }
        if body.is_grounded() {
            return self.run_up(&gap, body, profile);
        }
        let flight = Flight::of(&gap, body, profile);
        let is_settling = at < 0.0 && body.velocity.length() < SETTLING_SPEED && flight.height.abs() < SETTLING_M;
        if is_settling {
            return gap.turn(body, profile);
        }
        let lands_before = at + flight.speed * flight.seconds_to(0.0).unwrap_or(0.0) < -RIM_M;
        if lands_before {
            return self.approach(&gap, body, profile);
        }
        if flight.may_jump_late(body, profile) && flight.clearance(&gap, profile, None).0 < 0.0 {
            let jump = Flight { rising: profile.jump_speed, ..flight }.best(&gap, profile, air_jumps(profile));
            return Action { jump: 1.0, ..gap.fly(jump.speed, body, profile) };
        }
        let goes_on = body.air_jumps_left > 0 || body.can_dash(profile);
        let air_jumps = goes_on.then_some(std::iter::once(0).chain(AIR_JUMPS));
        let throw = flight.best(&gap, profile, air_jumps.into_iter().flatten());
        let jump = if throw.air_jump == Some(0) { 1.0 } else { -1.0 };
        Action { jump, ..gap.fly(throw.speed, body, profile) }
    }

    /// The action of a body on the ground before the gap.
    fn run_up(&self, gap: &Gap, body: &Body, profile: &CharacterProfile) -> Action {
        let run = self.approach(gap, body, profile);
        let is_faced = wrapped(heading(gap.ahead) - body.yaw).abs() <= FACED;
        let here = Flight::of(gap, body, profile);
        if !is_faced {
            return if here.at > -TURN_M { gap.turn(body, profile) } else { run };
        }
        let next = here.after_decision(run.forward * profile.forward_speed, profile);
        let falls = Flight { at: 0.0, height: 0.0, speed: next.speed, rising: 0.0, ..here };
        let is_aligned = gap.aside(body.feet) < ASIDE_M || here.at > -ALIGN_M;
        if falls.clearance(gap, profile, None).0 >= 0.0 || !is_aligned {
            return run;
        }
        let sure = RunUp::best(here, gap, profile, 0.0);
        if sure.is_none() && here.at > -self.longest_run_up(profile) && here.speed < LEAST_SPEED {
            return gap.fly(-BACK_SHARE * profile.forward_speed, body, profile);
        }
        match sure.or_else(|| RunUp::best(here, gap, profile, lip(profile))) {
            Some(RunUp { decisions: 0, throw, .. }) => Action { jump: 1.0, ..gap.fly(throw.speed, body, profile) },
            Some(run_up) => gap.fly(run_up.speed, body, profile),
            // No leap of this body clears the gap.
            None if here.at > -TURN_M => gap.turn(body, profile),
            None => run,
        }
    }

    /// How far from the rim a run-up begins, at most, m: where a body at rest reaches its top speed one stride before
    /// the rim, if there is room.
    fn longest_run_up(&self, profile: &CharacterProfile) -> f32 {
        let speed = profile.forward_speed;
        let full = 0.5 * speed * speed / profile.ground_acceleration + speed * DECISION_SECONDS + RUN_UP_SLACK_M;
        full.min(self.rims.run_up_m)
    }

    /// The action of a body that runs to the gap, as fast as the leap needs.
    fn approach(&self, gap: &Gap, body: &Body, profile: &CharacterProfile) -> Action {
        let is_far = gap.along(body.feet) < -ALIGN_M;
        let (to, then) =
            if is_far { (self.rims.take_off, self.course.to) } else { (self.course.to, self.course.to + gap.ahead) };
        let course = Course { then: Some(then), ..Course::straight(to) };
        let run = course.action(body, profile);
        let wish = hypot(run.forward, run.strafe * profile.side_speed_share);
        let brake = BRAKE * profile.ground_acceleration;
        // A decision passes before the next one can brake.
        let room = (-gap.along(body.feet) - body.velocity.dot(gap.ahead) * DECISION_SECONDS).max(0.0);
        let most = hypot(gap.run_up_speed(profile), (2.0 * brake * room).sqrt());
        let share = (most / profile.forward_speed / wish.max(f32::EPSILON)).min(1.0);
        Action { forward: run.forward * share, strafe: run.strafe * share, ..run }
    }
}

/// Whether a body that takes its run-up clears the gap between two rims on a leg that ends at `to`, m.
pub fn is_possible(rims: &Rims, to: Vec3, profile: &CharacterProfile) -> bool {
    let (gap, lip) = (Gap::of(rims, to), lip(profile));
    [gap.run_up_speed(profile), profile.forward_speed].into_iter().any(|speed| {
        let latest = -lip - 0.9 * speed * late_s(profile);
        TRIED_M.into_iter().chain([latest]).any(|before| {
            let run = Flight { at: -before, height: 0.0, speed, rising: 0.0, drop: profile.gravity };
            let jump = run.leaves_ground(profile, lip);
            jump.is_some_and(|jump| jump.best(&gap, profile, air_jumps(profile)).clearance >= -(lip + BEYOND_M))
        })
    })
}

/// Time after the ground has ended within which a body can jump in a decision, s.
fn late_s(profile: &CharacterProfile) -> f32 {
    f32::from(profile.coyote_ticks.saturating_sub(1)) * TICK_SECONDS
}

/// Decisions after a jump from the ground at which a body may jump in the air, or dash.
fn air_jumps(profile: &CharacterProfile) -> impl Iterator<Item = u32> {
    let goes_on = profile.extra_jumps > 0 || profile.dash_speed > 0.0;
    AIR_JUMPS.into_iter().take(if goes_on { AIR_JUMPS.len() } else { 0 })
}

/// A gap, seen along its leap from the rim before it.
#[derive(Debug, Clone, Copy)]
struct Gap {
    /// Horizontal unit vector of the leap.
    ahead: Vec3,
    take_off: Vec3,
    /// Distance between the rims, m.
    width: f32,
    /// Height of the far rim above the near one, m.
    rise: f32,
    /// Where the body lands, m.
    aim: f32,
}

impl Gap {
    fn of(&Rims { take_off, landing, .. }: &Rims, to: Vec3) -> Self {
        let ahead = (to - take_off).with_y(0.0).normalize_or_zero();
        let along = |at: Vec3| (at - take_off).dot(ahead);
        let width = along(landing);
        let aim = along(to).max(width + BEYOND_M);
        Self { ahead, take_off, width, rise: landing.y - take_off.y, aim }
    }

    /// How far a place is beyond the near rim, m.
    fn along(&self, at: Vec3) -> f32 {
        (at - self.take_off).dot(self.ahead)
    }

    /// How far a place is to the side of the line of the leap, m.
    fn aside(&self, at: Vec3) -> f32 {
        horizontal(at - self.take_off - self.ahead * self.along(at))
    }

    /// The action of a body in flight that aims at `speed`, m/s, along the leap, and faces a place beyond the landing.
    fn fly(&self, speed: f32, body: &Body, profile: &CharacterProfile) -> Action {
        let way = self.take_off + self.ahead * (self.aim + FACES_M) - body.feet;
        let most = profile.turn_speed * DECISION_SECONDS;
        let off = wrapped(heading(way) - body.yaw);
        let turn = turn_by(off, most);
        // In the middle of the decision, the body faces where it then moves, or a little to the side.
        let aside = wrapped(off - 0.5 * turn);
        Action { turn: turn / most, ..moving(aside, speed / profile.forward_speed, profile) }
    }

    /// The action of a body that stops and faces the leap.
    fn turn(&self, body: &Body, profile: &CharacterProfile) -> Action {
        let most = profile.turn_speed * DECISION_SECONDS;
        let turn = turn_by(wrapped(heading(self.ahead) - body.yaw), most);
        Action { turn: turn / most, ..Action::default() }
    }

    /// Speed at the rim with which a body lands where it aims, m/s.
    fn run_up_speed(&self, profile: &CharacterProfile) -> f32 {
        let flight = Flight { at: -RIM_M, height: 0.0, speed: 0.0, rising: profile.jump_speed, drop: profile.gravity };
        let jump = flight.seconds_to(self.rise);
        let twice = || flight.after_air_jump(AIR_JUMPS[2], profile).0.seconds_to(self.rise);
        let seconds = jump.or_else(|| Some(twice()? + AIR_JUMPS[2] as f32 * DECISION_SECONDS));
        let speed = seconds.map_or(profile.forward_speed, |seconds| (self.aim + RIM_M) / seconds);
        speed.clamp(LEAST_SPEED.min(profile.forward_speed), profile.forward_speed)
    }
}

/// A run to the rim before a gap, and the jump there.
#[derive(Debug, Clone, Copy)]
struct RunUp {
    /// Speed at which the body aims, m/s.
    speed: f32,
    /// Decisions until it jumps.
    decisions: u32,
    throw: Throw,
}

impl RunUp {
    /// The best run-up of a body on the ground that clears the gap. If possible, it is slow enough to land where the
    /// body aims. The body stands up to `lip` metres over both rims.
    fn best(here: Flight, gap: &Gap, profile: &CharacterProfile, lip: f32) -> Option<Self> {
        let (slow, top) = (gap.run_up_speed(profile), profile.forward_speed);
        let least = if lip > 0.0 { -(lip + BEYOND_M) } else { 0.0 };
        let mut best: Option<Self> = None;
        for speed in [slow, 0.5 * (slow + top), top] {
            let runs = Self::all((here, speed), gap, profile, lip).filter(|run| run.throw.clearance >= least);
            let jumps = runs.filter(|run| best.is_none_or(|best| run.throw.is_better(best.throw)));
            best = jumps.reduce(|a, b| if a.throw.is_better(b.throw) { a } else { b }).or(best);
            if best.is_some_and(|best| best.throw.air_jump.is_none() && best.throw.clearance >= ROOMY_M) {
                break;
            }
        }
        best
    }

    /// The run-ups at this speed, with a jump after each decision. A kerb that the body cannot step onto ends them.
    fn all(
        (here, speed): (Flight, f32),
        gap: &Gap,
        profile: &CharacterProfile,
        lip: f32,
    ) -> impl Iterator<Item = Self> {
        let states = std::iter::successors(Some(here), move |run| Some(run.after_decision(speed, profile)));
        let kerb = if gap.rise > profile.step_height { gap.width - profile.radius } else { f32::INFINITY };
        (0..RUN_UP_DECISIONS).zip(states).map_while(move |(decisions, run)| {
            if decisions > 0 && run.at > kerb {
                return None;
            }
            let throw = run.leaves_ground(profile, lip)?.best(gap, profile, air_jumps(profile));
            Some(Self { speed, decisions, throw })
        })
    }
}

/// How far a body stands over a rim, m, before its sole slides off: the sole is round.
fn lip(profile: &CharacterProfile) -> f32 {
    LIP_SHARE * profile.radius * libm::sinf(profile.max_slope)
}

/// A body in flight along a gap.
#[derive(Debug, Clone, Copy)]
struct Flight {
    /// How far the body is beyond the near rim, m.
    at: f32,
    /// Height above the near rim, m.
    height: f32,
    /// Speed along the leap, m/s.
    speed: f32,
    /// Upward speed, m/s.
    rising: f32,
    /// Gravity, m/s2.
    drop: f32,
}

/// What a body does in its flight.
#[derive(Debug, Clone, Copy)]
struct Throw {
    /// Decisions until the body jumps in the air, if it does.
    air_jump: Option<u32>,
    /// Speed along the leap at which the body aims, m/s.
    speed: f32,
    /// By how much the flight clears the gap, m; below 0 if it does not.
    clearance: f32,
}

impl Throw {
    /// Whether a flight is better than another: without a jump in the air, or with more room at the far rim.
    fn is_better(self, other: Self) -> bool {
        let rank = |throw: Self| (throw.clearance >= 0.0 && throw.air_jump.is_none(), throw.clearance.min(ROOMY_M));
        rank(self) > rank(other)
    }
}

impl Flight {
    fn of(gap: &Gap, body: &Body, profile: &CharacterProfile) -> Self {
        Self {
            at: gap.along(body.feet),
            height: body.feet.y - gap.take_off.y,
            speed: body.velocity.dot(gap.ahead),
            rising: body.velocity.y,
            drop: profile.gravity,
        }
    }

    /// The body when it jumps from here, where the ground ends `lip` metres beyond the rim. A body still jumps shortly
    /// after that; `None` if it is too late.
    fn leaves_ground(self, profile: &CharacterProfile, lip: f32) -> Option<Self> {
        let late = (self.at - lip).max(0.0) / self.speed.max(f32::EPSILON);
        let over = self.at.clamp(0.0, lip);
        let sunk = profile.radius - (profile.radius * profile.radius - over * over).sqrt();
        let height = self.height.min(-sunk) - 0.5 * self.drop * late * late;
        (late <= late_s(profile)).then_some(Self { height, rising: profile.jump_speed, ..self })
    }

    /// Whether the body has just run over the rim and can still jump from there.
    fn may_jump_late(self, body: &Body, profile: &CharacterProfile) -> bool {
        self.at >= -RIM_M && self.rising <= 0.0 && body.ticks_in_air < profile.coyote_ticks
    }

    /// The body after a decision on the ground in which it wants this speed, m/s.
    fn after_decision(self, wish: f32, profile: &CharacterProfile) -> Self {
        let most = profile.ground_acceleration * TICK_SECONDS;
        (0..TICKS_PER_DECISION).fold(self, |flight, _| {
            let speed = flight.speed + (wish - flight.speed).clamp(-most, most);
            Self { at: flight.at + speed * TICK_SECONDS, speed, ..flight }
        })
    }

    /// The body when it jumps in the air after so many decisions, and the time until then, s. Its place is that of now.
    fn after_air_jump(self, decisions: u32, profile: &CharacterProfile) -> (Self, f32) {
        let seconds = decisions as f32 * DECISION_SECONDS;
        let height = self.height + self.rising * seconds - 0.5 * self.drop * seconds * seconds;
        (Self { height, rising: profile.jump_speed, ..self }, seconds)
    }

    /// Time until the body falls below a height, s; `None` if it never is above it.
    fn seconds_to(self, height: f32) -> Option<f32> {
        let left = self.rising * self.rising - 2.0 * self.drop * (height - self.height);
        (left >= 0.0).then(|| (self.rising + left.sqrt()) / self.drop)
    }

    /// The best flight: without a jump in the air if that clears the gap, otherwise with one of these.
    fn best(self, gap: &Gap, profile: &CharacterProfile, air_jumps: impl Iterator<Item = u32>) -> Throw {
        let throw = |air_jump| {
            let (clearance, speed) = self.clearance(gap, profile, air_jump);
            Throw { air_jump, speed, clearance }
        };
        let plain = throw(None);
        if plain.clearance >= 0.0 {
            return plain;
        }
        let others = air_jumps.map(|decisions| throw(Some(decisions)));
        others.chain([plain]).max_by(|a, b| a.clearance.total_cmp(&b.clearance)).unwrap_or(plain)
    }

    /// By how much the body clears the gap, m, and the speed at which it aims, m/s.
    fn clearance(self, gap: &Gap, profile: &CharacterProfile, air_jump: Option<u32>) -> (f32, f32) {
        if let Some(decisions) = air_jump.filter(|_| profile.extra_jumps == 0) {
            return self.clearance_of_dash(gap, profile, decisions);
        }
        let (last, before) = air_jump.map_or((self, 0.0), |decisions| self.after_air_jump(decisions, profile));
        let Some(seconds) = last.seconds_to(gap.rise).map(|seconds| seconds + before) else {
            let peak = last.height + 0.5 * last.rising * last.rising / self.drop;
            return (peak - gap.rise, profile.forward_speed);
        };
        let speed = self.speed_for(gap.aim - self.at, seconds, profile);
        let lands_at = self.at + self.distance(speed, seconds, profile);
        let beyond = lands_at - (gap.width + BEYOND_M);
        let to_rim = gap.width - TOE_M - self.at;
        if to_rim <= 0.0 {
            return (beyond, speed);
        }
        let rim = self.seconds_over(to_rim, speed, seconds, profile);
        let (flight, after) = if rim < before { (self, rim) } else { (last, rim - before) };
        let height = flight.height + flight.rising * after - 0.5 * self.drop * after * after;
        (beyond.min(height - gap.rise - ABOVE_M), speed)
    }

    /// The same with a dash after so many decisions.
    fn clearance_of_dash(self, gap: &Gap, profile: &CharacterProfile, decisions: u32) -> (f32, f32) {
        let before = decisions as f32 * DECISION_SECONDS;
        let height_after = |flight: Self, seconds: f32| {
            flight.height + flight.rising * seconds - 0.5 * flight.drop * seconds * seconds
        };
        let dash_m = profile.dash_speed * f32::from(DASH_TICKS) * TICK_SECONDS;
        let height = height_after(self, before);
        let after = Self { height, rising: 0.0, speed: profile.dash_speed, ..self };
        let Some(seconds) = after.seconds_to(gap.rise) else { return (height - gap.rise, profile.forward_speed) };
        let begins = |wish: f32| self.at + self.distance(wish, before, profile);
        let lands = |wish: f32| begins(wish) + dash_m + after.distance(wish, seconds, profile);
        let slowest = -profile.side_speed_share * profile.forward_speed;
        let speed = least(slowest, profile.forward_speed, |wish| lands(wish) >= gap.aim);
        let (beyond, rim, begin) = (lands(speed) - (gap.width + BEYOND_M), gap.width - TOE_M, begins(speed));
        let over_rim = if begin >= rim {
            height_after(self, self.seconds_over(rim - self.at, speed, before, profile))
        } else {
            let left = (rim - begin - dash_m).max(0.0);
            height_after(after, after.seconds_over(left, speed, seconds, profile))
        };
        (beyond.min(over_rim - gap.rise - ABOVE_M), speed)
    }

    /// Distance that the body covers when it aims at `wish`, m/s.
    fn distance(self, wish: f32, seconds: f32, profile: &CharacterProfile) -> f32 {
        let change = wish - self.speed;
        let ramp = (change.abs() / profile.air_acceleration.max(f32::EPSILON)).min(seconds);
        let reached = self.speed + profile.air_acceleration * ramp * change.signum();
        0.5 * (self.speed + reached) * ramp + reached * (seconds - ramp)
    }

    /// Speed at which the body aims to cover a distance in this time, m/s.
    fn speed_for(self, distance: f32, seconds: f32, profile: &CharacterProfile) -> f32 {
        let slowest = -profile.side_speed_share * profile.forward_speed;
        least(slowest, profile.forward_speed, |wish| self.distance(wish, seconds, profile) >= distance)
    }

    /// Time that the body takes for a distance when it aims at `wish`, m/s, at most `most`, s.
    fn seconds_over(self, distance: f32, wish: f32, most: f32, profile: &CharacterProfile) -> f32 {
        least(0.0, most, |seconds| self.distance(wish, seconds, profile) >= distance)
    }
}

/// The least value between two others that is `enough`, by bisection; `high` if none is.
fn least(mut low: f32, mut high: f32, enough: impl Fn(f32) -> bool) -> f32 {
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if enough(middle) { high = middle } else { low = middle }
    }
    high
}
