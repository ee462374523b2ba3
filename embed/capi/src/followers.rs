//! Followers: attempts of NPCs at goals by plan, with the rules of NPCs on a server, and rehearsals.

use crate::abi;
use crate::agents::{Agents, Policy, Sensed};
use crate::error::{Fault, Status};
use crate::graphs::{self, Graph};
use crate::worlds::Map;
use surefoot_planner::evidence::TryEnd;
use surefoot_planner::{AbilitySet, Caution, Query};
use surefoot_rollout::follow::Step;
use surefoot_rollout::game::{self, GameAttempt, Prepared};
use surefoot_rollout::{FollowConfig, Follower as Rules};
use surefoot_world::map::{LevelFrame, Piece, PieceShape};
use surefoot_world::{Arrival, CharacterProfile, End, GAITS, Gait, NamedGait, Vec3};

/// Most threads of rehearsals.
const MAX_THREADS: u32 = 64;

/// `sf_rehearsals`: where legs of plans are run ahead of time.
#[derive(Debug)]
pub struct Rehearsals {
    inner: game::Rehearsals,
}

impl Rehearsals {
    /// Prepares rehearsals on a map, on `thread_count` threads; without threads they run in the calls.
    pub fn new(policy: &Policy, map: &Map, profile: CharacterProfile, thread_count: u32) -> Result<Self, Fault> {
        if thread_count > MAX_THREADS {
            let message = format!("thread_count is {thread_count}, but must be 0 to {MAX_THREADS}");
            return Err(Fault::argument(message));
        }
        let inner = game::Rehearsals::new(map.inner().clone(), profile, &policy.inner, thread_count as usize);
        Ok(Self { inner })
    }

    /// Puts exactly these blocks onto the level.
    pub fn set_blocks(&self, blocks: &[abi::Block]) -> Result<(), Fault> {
        let piece = |(idx, block): (usize, &abi::Block)| {
            let abi::Block { foot, width, depth, height, yaw } = *block;
            let foot = foot.checked(format!("blocks[{idx}].foot"))?;
            let shape = PieceShape::Block { foot, half: [width / 2.0, depth / 2.0], height, yaw };
            Ok(Piece { name: format!("blocks[{idx}]"), shape })
        };
        let pieces: Vec<Piece> = blocks.iter().enumerate().map(piece).collect::<Result<_, Fault>>()?;
        self.inner.set_pieces(pieces).map_err(|error| Fault::argument(error.to_string()))
    }
}

/// The gait with this name.
pub fn gait_named(name: &str) -> Result<abi::Gait, Fault> {
    let found = NamedGait::find(name).ok_or_else(|| {
        let names: Vec<&str> = GAITS.iter().map(|gait| gait.name).collect();
        Fault::new(Status::NotFound, format!("there is no gait {name}: use {}", names.join(", ")))
    })?;
    let Gait { speed, acceleration, turn_rate, wall_distance, avoids_jumps } = found.gait;
    let struct_size = size_of::<abi::Gait>() as u32;
    Ok(abi::Gait { struct_size, speed, acceleration, turn_rate, wall_distance, avoids_jumps: avoids_jumps.into() })
}

/// Checks a gait.
pub fn gait(gait: &abi::Gait) -> Result<Gait, Fault> {
    for (name, value, allowed) in [
        ("speed", gait.speed, Gait::SPEEDS),
        ("acceleration", gait.acceleration, Gait::ACCELERATIONS),
        ("turn_rate", gait.turn_rate, Gait::TURN_RATES),
        ("wall_distance", gait.wall_distance, Gait::WALL_DISTANCES),
    ] {
        if !allowed.contains(&value) {
            let (least, most) = allowed.into_inner();
            return Err(Fault::argument(format!("gait.{name} is {value}, but must be {least} to {most}")));
        }
    }
    let abi::Gait { speed, acceleration, turn_rate, wall_distance, avoids_jumps, .. } = *gait;
    Ok(Gait { speed, acceleration, turn_rate, wall_distance, avoids_jumps: avoids_jumps != 0 })
}

/// `sf_follower`: an attempt at a goal.
#[derive(Debug, Clone)]
pub struct Follower {
    attempt: GameAttempt,
    /// The level in whose coordinates the caller's places are; `None`: in those of the map.
    frame: Option<LevelFrame>,
    /// Traversals that the caller has not taken.
    traversals: Vec<abi::Traversal>,
    /// How the attempt ended.
    end: Option<End>,
}

impl Follower {
    /// Begins an attempt at `goal`. Without a frame, all places are on the map.
    pub fn new(goal: abi::Vec3, frame: Option<LevelFrame>) -> Result<Self, Fault> {
        let config = FollowConfig { composes: false, ..FollowConfig::default() };
        let rules = Rules::new(goal.on_map(frame.as_ref(), "goal")?, config);
        Ok(Self { attempt: GameAttempt::new(rules), frame, traversals: Vec::new(), end: None })
    }

    /// Moves the goal. The plan stays, and its last leg leads to the new goal, until the goal has drifted far: then the
    /// step asks for another plan.
    pub fn move_goal(&mut self, goal: abi::Vec3, feet: abi::Vec3, reached: bool) -> Result<abi::Step, Fault> {
        let goal = goal.on_map(self.frame.as_ref(), "goal")?;
        let feet = feet.on_map(self.frame.as_ref(), "feet")?;
        if let Some(end) = self.end {
            return Ok(self.step(Step::End(end)));
        }
        let waypoint = self.attempt.follow_goal(goal, feet, reached);
        let rules = self.attempt.follower();
        let needs_plan = rules.current_plan().is_none() || rules.has_goal_drifted(feet);
        let step = if needs_plan { Step::Plan } else { waypoint.map_or(Step::Keep, Step::HeadFor) };
        Ok(self.step(step))
    }

    /// Records a decision: where the feet are, and whether the NPC reached its waypoint.
    pub fn advance(&mut self, feet: abi::Vec3, reached: bool) -> Result<abi::Step, Fault> {
        let feet = feet.on_map(self.frame.as_ref(), "feet")?;
        if let Some(end) = self.end {
            return Ok(self.step(Step::End(end)));
        }
        // The last waypoint may lag behind a goal that has moved a little: then the goal itself is next.
        let goal = self.attempt.follower().goal();
        let goal_ahead = if reached { self.attempt.follow_goal(goal, feet, true) } else { None };
        let reached = reached && goal_ahead.is_none();
        let step = match (self.attempt.record_decision(feet, reached.then_some(End::Reached)), goal_ahead) {
            (Step::Keep, Some(goal)) => Step::HeadFor(goal),
            (step, _) => step,
        };
        self.collect();
        match step {
            // The caller decides whether the goal is reached.
            Step::End(End::Reached) | Step::Keep | Step::HeadFor(_) | Step::Plan => {}
            Step::End(end) => self.end = Some(end),
        }
        Ok(self.step(step))
    }

    /// Plans from `feet`, and follows that plan.
    pub fn plan(
        &mut self,
        graph: &Graph,
        feet: abi::Vec3,
        caution: Caution,
        without: AbilitySet,
    ) -> Result<abi::Step, Fault> {
        let feet = feet.on_map(self.frame.as_ref(), "feet")?;
        if let Some(end) = self.end {
            return Ok(self.step(Step::End(end)));
        }
        self.attempt.follower_mut().drop_plan();
        let waypoint = self.attempt.plan(feet, |query| {
            let without = query.without.union(without);
            graph.find(&Query { caution, without, ..query.clone() })
        });
        Ok(self.step(Step::HeadFor(waypoint)))
    }

    /// Changes how the NPC goes.
    pub fn set_gait(&mut self, gait: Gait) -> abi::Step {
        let needs_plan = self.attempt.set_gait(gait);
        self.step(match self.end {
            Some(end) => Step::End(end),
            None if needs_plan => Step::Plan,
            None => Step::Keep,
        })
    }

    /// Prepares the next decision of an agent, whose places have their origin at `origin` on the map, m.
    pub fn prepare(
        &mut self,
        rehearsals: &Rehearsals,
        (agents, agent): (&mut Agents, u32),
        sensed: &Sensed<'_>,
        origin: Vec3,
    ) -> Result<abi::Step, Fault> {
        if let Some(end) = self.end {
            return Ok(self.step(Step::End(end)));
        }
        if !agents.are_those_of(&rehearsals.inner) {
            return Err(Fault::argument("rehearsals are of another policy or body than agents: create both alike"));
        }
        self.attempt.follower_mut().compose();
        let (npc, memory, noise) = agents.rehearsing(agent, sensed, origin)?;
        let prepared = self.attempt.prepare(&rehearsals.inner, &npc, memory, noise);
        self.collect();
        let step = match prepared {
            Prepared::Act(style) => {
                agents.prepare(agent, style, npc)?;
                Step::Keep
            }
            Prepared::HeadFor(waypoint) => Step::HeadFor(waypoint),
            Prepared::Plan => Step::Plan,
        };
        Ok(self.step(step))
    }

    /// Records that the NPC died, which ends the attempt.
    pub fn record_death(&mut self) {
        if self.end.is_none() {
            self.attempt.follower_mut().record_harm();
            self.collect();
            self.end = Some(End::NoProgress);
        }
    }

    /// The legs of the plan that is followed.
    pub fn legs(&self) -> Result<Vec<abi::Leg>, Fault> {
        let missing = || Fault::new(Status::BadState, "the follower has no plan: call sf_follower_plan first");
        let legs = |plan| graphs::legs(plan, self.frame.as_ref()).collect();
        self.attempt.follower().current_plan().map(legs).ok_or_else(missing)
    }

    /// Traversals since the last call of [`forget_traversals`](Self::forget_traversals).
    pub fn traversals(&self) -> &[abi::Traversal] {
        &self.traversals
    }

    /// Forgets the traversals, which the caller has taken.
    pub fn forget_traversals(&mut self) {
        self.traversals.clear();
    }

    fn collect(&mut self) {
        self.traversals.extend(self.attempt.follower_mut().take_traversals().into_iter().map(|traversal| {
            abi::Traversal {
                key: abi::LegKey { from: traversal.edge.from.0, to: traversal.edge.to.0 },
                decisions: traversal.decisions,
                end: match traversal.end {
                    TryEnd::Arrived => 0,
                    TryEnd::Failed => 1,
                    TryEnd::Died => 2,
                },
            }
        }));
    }

    fn step(&self, step: Step) -> abi::Step {
        let kind = match step {
            Step::Keep | Step::End(End::Reached) => 0,
            Step::HeadFor(_) => 1,
            Step::Plan => 2,
            Step::End(End::Unreachable) => 4,
            Step::End(_) => 3,
        };
        let waypoint = |at| abi::Vec3::of_map(at, self.frame.as_ref());
        let rules = self.attempt.follower();
        let plan = rules.current_plan();
        abi::Step {
            struct_size: 0,
            kind,
            waypoint: rules.waypoint().map(waypoint).unwrap_or_default(),
            leg: plan.map_or(0, |_| rules.leg_idx() as u32),
            leg_count: plan.map_or(0, |plan| plan.legs.len() as u32),
            plans: rules.plans(),
            stands: (plan.is_some() && rules.arrival() == Arrival::Stand).into(),
        }
    }
}
