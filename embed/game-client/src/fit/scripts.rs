//! The scripts of actions that characters of a game follow.

use std::f32::consts::{FRAC_PI_2, PI};
use surefoot_world::Action;

/// Decisions at rest with which each script begins: a game may put a character a little above the ground.
pub const REST: usize = 2;

/// A fixed sequence of actions, one for each decision.
#[derive(Debug)]
pub struct Script {
    /// Name in reports.
    pub name: &'static str,
    /// Angle from the lane to the heading, rad: a body that goes backwards faces away from it.
    pub(super) facing: f32,
    /// Whether it begins at random places instead of on open lanes.
    pub(super) is_rough: bool,
    parts: &'static [(usize, Action)],
}

impl Script {
    /// Its actions.
    pub fn actions(&self) -> Vec<Action> {
        let rest = (REST, STILL);
        [rest].iter().chain(self.parts).flat_map(|&(count, action)| std::iter::repeat_n(action, count)).collect()
    }
}

const STILL: Action = Action { forward: 0.0, strafe: 0.0, turn: 0.0, jump: 0.0 };
const RUN: Action = Action { forward: 1.0, ..STILL };
const RUN_AND_JUMP: Action = Action { jump: 1.0, ..RUN };
/// A body that turns this little stays on the lane.
const LEFT: Action = Action { turn: 0.4, ..RUN };
const RIGHT: Action = Action { turn: -0.4, ..RUN };
const LEAP: Action = Action { jump: 1.0, ..STILL };

/// All scripts.
pub const SCRIPTS: [Script; 13] = [
    on_lane("run", 0.0, &[(9, RUN)]),
    on_lane("brake", 0.0, &[(5, RUN), (6, STILL)]),
    on_lane("walk", 0.0, &[(9, Action { forward: 0.4, ..STILL })]),
    on_lane("back", PI, &[(8, Action { forward: -1.0, ..STILL })]),
    on_lane("sideways", FRAC_PI_2, &[(8, Action { strafe: 1.0, ..STILL })]),
    on_lane("turn", 0.0, &[(1, RUN), (1, LEFT), (2, RIGHT), (2, LEFT), (2, RIGHT), (1, LEFT)]),
    on_lane("jump", 0.0, &[(1, LEAP), (8, STILL)]),
    on_lane("running jump", 0.0, &[(4, RUN), (1, RUN_AND_JUMP), (7, RUN)]),
    on_lane("jump and brake", 0.0, &[(4, RUN), (1, RUN_AND_JUMP), (7, STILL)]),
    on_lane("jump on the spot, then run", 0.0, &[(1, LEAP), (8, RUN)]),
    on_lane("second jump", 0.0, &[(3, RUN), (1, RUN_AND_JUMP), (1, RUN), (1, RUN_AND_JUMP), (8, RUN)]),
    on_lane("third jump", 0.0, &[(1, LEAP), (1, STILL), (1, LEAP), (1, STILL), (1, LEAP), (9, STILL)]),
    Script { is_rough: true, ..on_lane("steps and slopes", 0.0, &[(14, RUN)]) },
];

const fn on_lane(name: &'static str, facing: f32, parts: &'static [(usize, Action)]) -> Script {
    Script { name, facing, is_rough: false, parts }
}
