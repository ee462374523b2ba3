//! The decision loop, and what training, probing, evaluation, environments and pictures share around it.
//!
//! [`decision`] is the loop: observe, act, ten ticks, close. [`goals`] draws starts and goals, [`follow`] follows a plan,
//! [`style`] shapes actions so that NPCs look composed, [`motion`] measures how they move,
//! [`attempts`] runs whole episodes, straight or by plan, [`probe`] runs the short episodes that prove edges, [`rehearse`]
//! runs legs ahead of NPCs, [`drive`] is a plain controller that follows a path without a policy, [`shape`] measures where the leaps of an
//! edge begin and end, [`env`](mod@env) lets a caller choose the actions, [`crowd`] keeps NPCs moving for recordings, and
//! [`graphs`] builds graphs with probes that run in this process.
//!
//! This crate neither learns nor uses the network.

mod aside;
pub mod attempts;
pub mod crowd;
pub mod decision;
pub mod drive;
pub mod env;
pub mod follow;
pub mod goals;
pub mod graphs;
pub mod motion;
pub mod probe;
pub mod rehearse;
pub mod scene;
pub mod shape;
pub mod style;

pub use attempts::{Attempt, Rollout};
pub use decision::{DEFAULT_NOISE_SHARE, DecisionLoop, Lane, Noise, Stage};
pub use follow::{Fault, FollowConfig, Follower};
pub use goals::Goal;
pub use motion::Motion;
pub use probe::{InProcess, ProbeContext};
pub use style::Style;
