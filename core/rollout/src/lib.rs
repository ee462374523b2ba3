//! The decision loop, and the parts around it that training, probing, evaluation, environments and pictures share.
//!
//! - [`decision`]: observe, act, ten ticks, close; [`style`] shapes the actions and [`motion`] measures how NPCs move.
//! - [`attempt`]: the state machine of an NPC on its way to a goal; [`follow`] follows a plan and [`rehearse`] runs its
//!   next legs ahead of time. [`attempts`] runs many of them in this process, and [`game`] those of NPCs whose bodies a
//!   game moves.
//! - [`probe`]: the short episodes that prove edges; [`graphs`] builds graphs with them, and [`shape`] measures where
//!   the leaps of an edge begin and end, with [`drive`], a controller that follows a path without a policy.
//! - [`env`](mod@env): NPCs whose actions the caller chooses; [`goals`] draws starts and goals, and [`crowd`] keeps
//!   NPCs busy.
//!
//! This crate neither learns nor uses the network.

pub mod attempt;
pub mod attempts;
pub mod cross;
pub mod crowd;
pub mod decision;
pub mod drive;
pub mod env;
pub mod follow;
pub mod game;
pub mod goals;
pub mod graphs;
pub mod leap;
pub mod motion;
pub mod probe;
pub mod rehearse;
pub mod shape;
pub mod steer;
pub mod style;

pub use attempt::Attempt;
pub use attempts::{AttemptResult, Rollout};
pub use decision::{DEFAULT_NOISE_SHARE, DecidingNpc, DecisionBatch, DecisionLoop, Noise};
pub use follow::{Fault, FollowConfig, Follower};
pub use goals::Goal;
pub use motion::Motion;
pub use probe::{InProcess, ProbeContext};
pub use style::Style;
