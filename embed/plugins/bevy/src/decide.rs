//! Decisions: one batch for all agents of a policy.

use crate::SurefootDevices;
use crate::agent::{AgentAction, AgentState, Sight, SurefootAgent};
use crate::mind::{Mind, body_of};
use crate::policy::{DefaultPolicy, SurefootPolicy};
use bevy_ecs::prelude::*;
use surefoot_policy::{Batch as Rows, Scratch};
use surefoot_rollout::Style;
use surefoot_world::sense::{self, Found, RAY_COUNT, SenseContext};
use surefoot_world::{Action, Npc, TaskConfig};

/// Room for the rows of each policy.
#[derive(Resource, Debug, Default)]
pub(crate) struct Batches(Vec<Batch>);

#[derive(Debug)]
struct Batch {
    policy: SurefootPolicy,
    scratch: Scratch,
    agents: Vec<Entity>,
    observations: Vec<f32>,
    memories: Vec<f32>,
    noise: Vec<f32>,
    actions: Vec<Action>,
}

type Agents<'w, 's> = Query<
    'w,
    's,
    (
        Entity,
        &'static SurefootAgent,
        &'static AgentState,
        &'static Sight,
        Option<&'static SurefootPolicy>,
        &'static mut Mind,
        &'static mut AgentAction,
    ),
>;

/// Decides for all agents whose sight was wanted.
pub(crate) fn decide(
    policy: Res<'_, DefaultPolicy>,
    devices: Res<'_, SurefootDevices>,
    mut batches: ResMut<'_, Batches>,
    mut agents: Agents<'_, '_>,
) {
    let task = TaskConfig::default();
    for (agent, settings, state, sight, own, mut mind, _) in &mut agents {
        if !sight.is_wanted {
            continue;
        }
        let batch = batches.of(own.unwrap_or(&policy.0));
        let context = SenseContext { placed: &devices.0, profile: &settings.body, task: &task };
        batch.add(agent, (settings, state, sight), &mut mind, context);
    }
    for batch in &mut batches.0 {
        batch.act();
        let memory_len = batch.policy.inner.memory_len();
        for (row, agent) in batch.agents.drain(..).enumerate() {
            let Ok((_, settings, state, _, _, mut mind, mut action)) = agents.get_mut(agent) else { continue };
            let decided = batch.actions[row];
            let shape = |(style, npc): (Style, Npc)| style.shape(decided, &npc, &settings.body);
            let shaped = mind.prepared.take().map_or(decided, shape);
            *action = AgentAction { action: shaped, is_first: true };
            mind.memory.copy_from_slice(&batch.memories[row * memory_len..(row + 1) * memory_len]);
            (mind.last.velocity, mind.last.action) = (state.velocity, shaped.to_array());
            if let Some(attempt) = &mut mind.attempt {
                attempt.has_decided = true;
            }
        }
    }
    // Policies that went out of use are dropped when others decide.
    let has_acted = batches.0.iter().any(|batch| !batch.actions.is_empty());
    batches.0.retain(|batch| !has_acted || !batch.actions.is_empty());
    batches.0.iter_mut().for_each(Batch::clear);
}

impl Batches {
    fn of(&mut self, policy: &SurefootPolicy) -> &mut Batch {
        let idx = self.0.iter().position(|batch| batch.policy == *policy).unwrap_or_else(|| {
            self.0.push(Batch::new(policy.clone()));
            self.0.len() - 1
        });
        &mut self.0[idx]
    }
}

impl Batch {
    fn new(policy: SurefootPolicy) -> Self {
        let (scratch, agents, observations, memories, noise, actions) = Default::default();
        Self { policy, scratch, agents, observations, memories, noise, actions }
    }

    fn clear(&mut self) {
        [&mut self.observations, &mut self.memories, &mut self.noise].into_iter().for_each(Vec::clear);
    }

    fn add(
        &mut self,
        agent: Entity,
        (settings, state, sight): (&SurefootAgent, &AgentState, &Sight),
        mind: &mut Mind,
        context: SenseContext<'_>,
    ) {
        let Some(attempt) = &mind.attempt else { return };
        let (at, len) = (self.observations.len(), self.policy.inner.observation_len());
        self.observations.resize(at + len, 0.0);
        let found = Found { hits: &sight.hits, body_hits: &[f32::INFINITY; RAY_COUNT], others: &[] };
        sense::observe_found(
            context,
            found,
            (&body_of(state), &attempt.episode, &mind.last),
            &mut self.observations[at..],
        );
        mind.memory.resize(self.policy.inner.memory_len(), 0.0);
        self.memories.extend(&mind.memory);
        self.noise.extend(mind.draw(settings.seed_of(agent), settings.noise_share));
        self.agents.push(agent);
    }

    fn act(&mut self) {
        let Self { policy, scratch, observations, memories, noise, actions, .. } = self;
        policy.inner.act(Rows { observations, memory: memories, noise }, scratch, actions);
    }
}
