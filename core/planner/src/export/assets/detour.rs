//! Off-mesh connections in the fields of Detour's `dtNavMeshCreateParams`.

use super::{About, Axes, Hint, LinkSet, kind_of, name_of};
use serde::{Deserialize, Serialize};
use surefoot_world::Ability;

/// Area of drops; the other abilities follow. Recast reserves 0 and 63.
const FIRST_AREA: u8 = 1;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct OffMeshLinks {
    /// The level's own origin on the map, if known. Subtract it from positions to get the level's coordinates.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    origin: Option<[f32; 3]>,
    /// Number of links.
    off_mesh_con_count: usize,
    /// Start and end of each link: count x 6 coordinates, m.
    off_mesh_con_verts: Vec<f32>,
    /// Radius of the ends of each link, m.
    off_mesh_con_rad: Vec<f32>,
    /// Direction of each link: always 0, from start to end only.
    off_mesh_con_dir: Vec<u8>,
    /// Area of each link; every ability has an area of its own.
    off_mesh_con_areas: Vec<u8>,
    /// Flags of each link: one bit for each ability, from bit 0; bit 6 for drops.
    off_mesh_con_flags: Vec<u16>,
    /// Index of each link's edge in the graph's JSON export.
    #[serde(rename = "offMeshConUserID")]
    off_mesh_con_user_id: Vec<u32>,
    /// The cost that a search should minimise, s. This field and the following ones are not part of Detour. Area
    /// costs can be derived from it.
    off_mesh_con_seconds: Vec<f32>,
    /// Estimated chance that an NPC with the policy gets through each link, 0 to 1.
    off_mesh_con_chance: Vec<f32>,
    /// Share of the tries of a plain scripted controller that got through each link, 0 to 1.
    off_mesh_con_driven: Vec<f32>,
    /// The leaps of each link.
    off_mesh_con_leaps: Vec<Vec<Hint>>,
    /// Area and flag of each ability.
    legend: Vec<AbilityKey>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct AbilityKey {
    ability: String,
    area: u8,
    flag: u16,
}

impl AbilityKey {
    fn of(ability: Ability) -> Self {
        let flag = if ability == Ability::Walk { 1 << 6 } else { 1 << (ability as u16 - 1) };
        Self { ability: name_of(ability).to_owned(), area: FIRST_AREA + kind_of(ability), flag }
    }
}

impl OffMeshLinks {
    pub(super) fn of(set: &LinkSet) -> Self {
        let links = &set.links;
        let abouts: Vec<About> = links.iter().map(|link| About::of(link, Axes::Ours)).collect();
        let keys: Vec<AbilityKey> = links.iter().map(|link| AbilityKey::of(link.ability)).collect();
        let ends = links.iter().flat_map(|link| [link.passage.start, link.passage.end]);
        Self {
            origin: set.origin_on(Axes::Ours),
            off_mesh_con_count: links.len(),
            off_mesh_con_verts: ends.flat_map(|end| Axes::Ours.point(end)).collect(),
            off_mesh_con_rad: vec![set.radius; links.len()],
            off_mesh_con_dir: vec![0; links.len()],
            off_mesh_con_areas: keys.iter().map(|key| key.area).collect(),
            off_mesh_con_flags: keys.iter().map(|key| key.flag).collect(),
            off_mesh_con_user_id: links.iter().map(|link| link.edge_idx).collect(),
            off_mesh_con_seconds: abouts.iter().map(|about| about.cost_seconds).collect(),
            off_mesh_con_chance: abouts.iter().map(|about| about.chance).collect(),
            off_mesh_con_driven: abouts.iter().map(|about| about.driven).collect(),
            off_mesh_con_leaps: abouts.into_iter().map(|about| about.leaps).collect(),
            legend: Ability::ALL.iter().copied().map(AbilityKey::of).collect(),
        }
    }
}
