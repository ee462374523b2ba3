//! Where the agents of a graph rehearse: the level, with what the app has put into it.

use crate::error::SurefootError;
use crate::policy::SurefootPolicy;
use bevy_math::Vec3;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use surefoot_rollout::game::Rehearsals;
use surefoot_world::map::{Piece, PieceShape};
use surefoot_world::{CharacterProfile, Map};

/// An upright box that the app has put into its level, such as a crate, a barricade or a closed door.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurefootBlock {
    /// Its centre in the coordinates of the scene, m.
    pub centre: Vec3,
    /// Extents along x, y and z before it is turned, 0.05 to 1000 m.
    pub size: Vec3,
    /// Turn about the upright axis, rad, counter-clockwise seen from above.
    pub yaw: f32,
}

/// The rehearsals of a graph.
#[derive(Debug)]
pub(crate) struct Stage {
    thread_count: usize,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    /// The level with its blocks.
    map: Arc<Map>,
    /// The rehearsals of each policy and body.
    made: Vec<(SurefootPolicy, CharacterProfile, Arc<Rehearsals>)>,
}

impl Stage {
    pub fn new(map: Arc<Map>, thread_count: usize) -> Self {
        Self { thread_count, state: Mutex::new(State { map, made: Vec::new() }) }
    }

    /// The rehearsals for agents with this policy and body.
    pub fn rehearsals(&self, policy: &SurefootPolicy, body: &CharacterProfile) -> Arc<Rehearsals> {
        let mut state = self.state();
        if let Some((.., known)) = state.made.iter().find(|(of, profile, _)| of == policy && profile == body) {
            return known.clone();
        }
        let new = Arc::new(Rehearsals::new(state.map.clone(), body.clone(), &policy.inner, self.thread_count));
        state.made.push((policy.clone(), body.clone(), new.clone()));
        new
    }

    /// Puts exactly these blocks into the level, whose scene has its origin at `origin` on the map, m.
    pub fn set_blocks(&self, blocks: &[SurefootBlock], origin: Vec3) -> Result<(), SurefootError> {
        let piece = |(idx, block): (usize, &SurefootBlock)| {
            let SurefootBlock { centre, size, yaw } = *block;
            let foot = centre + origin - Vec3::Y * (size.y / 2.0);
            let shape = PieceShape::Block { foot, half: [size.x / 2.0, size.z / 2.0], height: size.y, yaw };
            Piece { name: format!("blocks[{idx}]"), shape }
        };
        let pieces: Vec<Piece> = blocks.iter().enumerate().map(piece).collect();
        let mut state = self.state();
        state.map = Arc::new(state.map.with_pieces(pieces.clone())?);
        for (.., rehearsals) in &state.made {
            rehearsals.set_pieces(pieces.clone())?;
        }
        Ok(())
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
