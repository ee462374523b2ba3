//! What the NPCs of a world see.

use super::World;
use crate::character::Body;
use crate::npc::NpcSlot;
use crate::player::Player;
use crate::sense::{self, Other, SenseContext, Sight};
use crate::slot::BodySlot;

impl World {
    /// Writes the NPC's observation into `row`, without other bodies if the row is too short for them. Writes zeros and
    /// returns false if the NPC has no episode.
    pub fn observe(&self, slot: NpcSlot, row: &mut [f32]) -> bool {
        let npc = self.npc(slot).expect("observe an occupied slot");
        let Some(episode) = &npc.episode else {
            row.fill(0.0);
            return false;
        };
        let profile = &self.config.profiles[usize::from(npc.profile.0)];
        let context = SenseContext { placed: self.map.placed(), profile, task: &self.config.task };
        let own = (&npc.body, episode, &npc.last);
        sense::observe(&self.cone, context, (&self.map, &self.movers), || self.others(slot, &npc.body), own, row);
        true
    }

    /// Casts the rays of an NPC, for display.
    pub fn sight(&self, slot: NpcSlot) -> Sight {
        let npc = self.npc(slot).expect("an occupied slot");
        let profile = self.profile_of(npc);
        let others = self.others(slot, &npc.body).map(|(_, other)| other);
        Sight::of(&self.cone, &self.map, &self.movers, profile, &npc.body, others)
    }

    /// The bodies that an NPC may see, in no order.
    fn others(&self, slot: NpcSlot, body: &Body) -> impl Iterator<Item = (BodySlot, Other)> {
        let near = self.neighbours.around(body.feet, sense::REACH_M, self.bodies());
        near.filter(move |(body, _)| *body != BodySlot::Npc(slot))
    }

    /// All bodies that obstruct NPCs.
    fn bodies(&self) -> impl Iterator<Item = (BodySlot, Other)> {
        let npcs = self.npcs().map(|(slot, _)| BodySlot::Npc(slot));
        let players = self.players().map(|(slot, _)| BodySlot::Player(slot));
        npcs.chain(players).filter_map(|body| Some((body, self.other(body)?)))
    }

    /// A body as others see it; `None` if it obstructs no NPC.
    fn other(&self, body: BodySlot) -> Option<Other> {
        match body {
            BodySlot::Npc(slot) => {
                let npc = self.npc(slot).filter(|npc| self.config.npc_collision && npc.is_solid())?;
                let profile = self.profile_of(npc);
                let (radius, height) = (profile.radius, profile.height);
                Some(Other { feet: npc.body.feet, velocity: npc.body.velocity, radius, height })
            }
            BodySlot::Player(slot) => {
                let &Player { feet, velocity, radius, height, .. } =
                    self.player(slot).filter(|player| player.is_solid())?;
                Some(Other { feet, velocity, radius, height })
            }
        }
    }

    /// Adds a body that has appeared or moved to the index of neighbours.
    pub(super) fn list(&mut self, body: BodySlot) {
        if let Some(other) = self.other(body) {
            self.neighbours.add(body, other);
        }
    }

    /// Removes a body that is about to move or disappear from the index of neighbours.
    pub(super) fn unlist(&mut self, body: BodySlot) {
        if let Some(other) = self.other(body) {
            self.neighbours.remove(body, other);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{MapSize, Placed};
    use crate::mesh::{Surface, Triangle};
    use crate::sense::RayCone;
    use crate::{Action, CharacterProfile, Map, PlayerContact, PlayerSlot, TaskConfig, Vec3, WorldConfig};
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;
    use std::sync::Arc;

    const SIDE_M: f32 = 120.0;

    /// What happens to a world between two looks; slots are taken modulo the number of slots.
    #[derive(Debug, Clone)]
    enum Step {
        Tick,
        Spawn(Vec3),
        Despawn(u32),
        Teleport(u32, Vec3),
        Player(Vec3),
        MovePlayer(u32, Vec3),
        RemovePlayer(u32),
        Restore,
    }

    /// Most places are on the floor, some far outside of it.
    fn place() -> impl Strategy<Value = Vec3> {
        let on = (0.0..SIDE_M, 0.5..4.0f32, 0.0..SIDE_M).prop_map(Vec3::from);
        let far = prop::sample::select(vec![Vec3::splat(-40.0), Vec3::new(3.0e7, 1.0, -3.0e7), Vec3::splat(8.0)]);
        prop_oneof![9 => on, 1 => far]
    }

    fn step() -> impl Strategy<Value = Step> {
        prop_oneof![
            4 => Just(Step::Tick),
            4 => place().prop_map(Step::Spawn),
            1 => any::<u32>().prop_map(Step::Despawn),
            2 => (any::<u32>(), place()).prop_map(|(slot, to)| Step::Teleport(slot, to)),
            2 => place().prop_map(Step::Player),
            2 => (any::<u32>(), place()).prop_map(|(slot, to)| Step::MovePlayer(slot, to)),
            1 => any::<u32>().prop_map(Step::RemovePlayer),
            1 => Just(Step::Restore),
        ]
    }

    fn floor() -> Arc<Map> {
        let corner = |x: f32, z: f32| Vec3::new(x * SIDE_M, 0.5, z * SIDE_M);
        let [a, b, c, d] = [corner(0.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0), corner(1.0, 0.0)];
        let triangles = [[a, b, c], [a, c, d]].into_iter().filter_map(|it| Triangle::new(it, Surface::Ground));
        let size = MapSize { width: 120, height: 20, depth: 120 };
        Arc::new(Map::from_parts(size, triangles.collect(), Placed::default()))
    }

    fn apply(world: &mut World, step: &Step) {
        let npc = |world: &World, slot: u32| NpcSlot(slot % world.slot_count().max(1) as u32);
        let player = |slot: u32| PlayerSlot(slot % 8);
        match *step {
            Step::Tick => world.tick(),
            Step::Spawn(feet) => {
                let slot = world.spawn(feet, feet.x);
                world.set_waypoint(slot, Vec3::splat(60.0));
                world.decide(slot, Action { forward: 1.0, strafe: 0.3, turn: 0.2, jump: 1.0 });
            }
            Step::Despawn(slot) => _ = world.despawn(npc(world, slot)),
            Step::Teleport(slot, to) => {
                let slot = npc(world, slot);
                if world.npc(slot).is_some() {
                    world.teleport(slot, to, to.z);
                    world.set_waypoint(slot, Vec3::splat(60.0));
                }
            }
            Step::Player(feet) => {
                let contact = if feet.x < 20.0 { PlayerContact::Ghost } else { PlayerContact::Block };
                world.spawn_player(Player { feet, velocity: Vec3::X, radius: 0.4, height: 5.0, contact });
            }
            Step::MovePlayer(slot, to) => _ = world.move_player(player(slot), to, Vec3::Z),
            Step::RemovePlayer(slot) => _ = world.remove_player(player(slot)),
            Step::Restore => world.restore(world.save()),
        }
    }

    /// The rays that end on others, and the nearest bodies, by the plain search through all bodies of the world, as
    /// bits.
    fn plain(world: &World, slot: NpcSlot) -> Vec<u32> {
        let npc = world.npc(slot).unwrap();
        let all = world.bodies().filter(|(body, _)| *body != BodySlot::Npc(slot));
        let eye = RayCone::eye(world.profile_of(npc), &npc.body);
        let mut row = vec![0.0; crate::OBSERVATION_WITH_OTHERS_LEN];
        world.observe(slot, &mut row);
        let (own, social) = row.split_at_mut(crate::OBSERVATION_LEN);
        let scene = (&*world.map, &world.movers);
        sense::observe_others(&world.cone, scene, (eye, &npc.body), all, &own[..crate::RAY_COUNT], social);
        row.iter().map(|value| value.to_bits()).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 96, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default()
        })]

        #[test]
        fn an_npc_sees_the_others_that_a_search_through_all_bodies_finds(
            begin in prop::collection::vec(place(), 1..80),
            steps in prop::collection::vec(step(), 1..24),
            npc_collision in any::<bool>(),
        ) {
            let config = WorldConfig::new(CharacterProfile::default(), TaskConfig::default(), npc_collision);
            let mut world = World::with_config(floor(), config);
            begin.into_iter().for_each(|feet| apply(&mut world, &Step::Spawn(feet)));
            for step in steps {
                apply(&mut world, &step);
                for slot in world.npcs().map(|(slot, _)| slot) {
                    let mut row = vec![0.0; crate::OBSERVATION_WITH_OTHERS_LEN];
                    world.observe(slot, &mut row);
                    let row: Vec<u32> = row.into_iter().map(f32::to_bits).collect();
                    prop_assert_eq!(row, plain(&world, slot), "NPC {} after {:?}", slot.0, step);
                }
            }
        }
    }
}
