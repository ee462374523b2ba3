//! The JSON formats: the fields of engines, beside those that all formats have.

use super::{Axes, Connected, Leap, Link, LinkSet};
use crate::export::FrameFields;
use serde::Serialize;
use surefoot_world::character::OwnMove;
use surefoot_world::float::hypot;
use surefoot_world::{Ability, MOVES, Vec3};

/// Version of the JSON formats: grows when a field changes its meaning or is removed.
const VERSION: u32 = 1;
/// Area of drops in Recast, which reserves 0 and 63; the other abilities follow.
const FIRST_DETOUR_AREA: u8 = 1;
/// Area of drops in Unity, whose own areas are 0 to 2; the other abilities follow, the last ones
/// in the last area.
const FIRST_UNITY_AREA: u8 = 3;
const LAST_UNITY_AREA: u8 = 31;
/// Length of the edges of a link in landmass, m: the distance that a NavMesh keeps from ledges.
const LANDMASS_EDGE_M: f32 = 0.75;

/// A coordinate: of a place on the map, or of the level's origin, which may lie far from it.
#[derive(Serialize)]
#[serde(untagged)]
enum Number {
    Near(f32),
    Far(f64),
}

/// A document with the links of a format. `P` is a point, `H` has further fields of the document, `L` is a link.
#[derive(Serialize)]
struct Document<P, H, L> {
    version: u32,
    axes: &'static str,
    /// Subtract the origin from positions to get those of the level, in the format's unit and axes.
    #[serde(flatten)]
    frame: FrameFields<P>,
    #[serde(flatten)]
    head: H,
    links: Vec<L>,
}

fn document<P: Serialize, L: Serialize>(
    set: &LinkSet,
    axes: Axes,
    point: fn([Number; 3]) -> P,
    head: impl Serialize,
    link: impl Fn(&Link, &dyn Fn(Vec3) -> P) -> L,
) -> String {
    let at = |place: Vec3| point(axes.point(place).map(Number::Near));
    json(&Document {
        version: VERSION,
        axes: axes.words(),
        frame: FrameFields::of(set.frame, |origin| point(axes.far_point(origin).map(Number::Far))),
        head,
        links: set.links.iter().map(|it| link(it, &at)).collect(),
    })
}

fn json(document: &impl Serialize) -> String {
    serde_json::to_string_pretty(document).expect("links are plain data") + "\n"
}

/// The name of an ability in the links of a set; a walk without ground underneath is a drop.
fn name_of(set: &LinkSet, ability: Ability) -> &str {
    if ability == Ability::WALK { "drop" } else { OwnMove::name_in(&set.moves, ability) }
}

/// A number of an ability that engines can filter by, from 0 for drops; the body's own moves come last.
fn kind_of(ability: Ability) -> u8 {
    ability.own_idx().map_or(ability.into(), |idx| (MOVES.len() + idx) as u8)
}

/// A leap as hints for an animation, on the axes of a format.
#[derive(Serialize)]
pub(super) struct Hint<'a> {
    pub ability: &'a str,
    /// What a game plays meanwhile, for a move of the body's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub animation: Option<&'a str>,
    pub take_off: [f32; 3],
    pub apex: [f32; 3],
    pub landing: [f32; 3],
    /// s.
    pub seconds: f32,
    /// Horizontal speed at take-off, in the format's unit of length per second.
    pub speed: f32,
    /// Time from take-off to a jump in the air, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub second_jump: Option<f32>,
}

/// The fields of a link besides its ends that all JSON formats have, on the axes of a format.
#[derive(Serialize)]
pub(super) struct About<'a> {
    /// Index of the edge in the graph's JSON export.
    pub edge: u32,
    pub ability: &'a str,
    /// Estimated chance that an NPC with the policy gets through, 0 to 1.
    pub chance: f32,
    /// Share of the tries of a plain scripted controller that got through, 0 to 1.
    pub driven: f32,
    /// Duration of a run that gets through, s.
    pub seconds: f32,
    /// The cost that a search should minimise, s.
    cost_seconds: f32,
    /// The leaps, in order.
    pub leaps: Vec<Hint<'a>>,
}

impl<'a> About<'a> {
    pub fn of(set: &'a LinkSet, link: &Link, axes: Axes) -> Self {
        let own = |ability: Ability| ability.own_idx().and_then(|idx| set.moves.get(idx));
        let hint = |leap: &Leap| Hint {
            ability: name_of(set, leap.ability),
            animation: own(leap.ability).map(OwnMove::animation),
            take_off: axes.point(leap.take_off),
            apex: axes.point(leap.apex),
            landing: axes.point(leap.landing),
            seconds: leap.seconds,
            speed: leap.speed * axes.units_per_metre(),
            second_jump: leap.second_jump,
        };
        Self {
            edge: link.edge_idx,
            ability: name_of(set, link.ability),
            chance: link.chance as f32,
            driven: link.passage.driven,
            seconds: link.passage.seconds,
            cost_seconds: link.cost_seconds as f32,
            leaps: link.passage.leaps.iter().map(hint).collect(),
        }
    }
}

/// An ability and its number.
#[derive(Serialize)]
struct Kind<'a> {
    ability: &'a str,
    kind: u8,
}

/// All abilities of the body, from the least demanding to its own.
fn abilities(set: &LinkSet) -> impl Iterator<Item = Ability> {
    OwnMove::all_with(&set.moves).map(|(ability, _)| ability)
}

/// The numbers of all abilities of the body, from `first` to at most `last`.
fn kinds(set: &LinkSet, first: u8, last: u8) -> Vec<Kind<'_>> {
    abilities(set).map(|it| Kind { ability: name_of(set, it), kind: (first + kind_of(it)).min(last) }).collect()
}

/// All fields of the links: docs/guides/links.md has the schema.
pub(super) fn plain(set: &LinkSet) -> String {
    #[derive(Serialize)]
    struct Agent {
        /// m.
        radius: f32,
        /// m/s.
        speed: f32,
    }
    #[derive(Serialize)]
    struct Head {
        agent: Agent,
        connected: Connected,
    }
    #[derive(Serialize)]
    struct PlainLink<'a> {
        start: [Number; 3],
        end: [Number; 3],
        bidirectional: bool,
        #[serde(flatten)]
        about: About<'a>,
    }
    let head = Head { agent: Agent { radius: set.radius, speed: set.speed }, connected: set.connected };
    document(
        set,
        Axes::Ours,
        |point| point,
        head,
        |link, at| PlainLink {
            start: at(link.passage.start),
            end: at(link.passage.end),
            bidirectional: false,
            about: About::of(set, link, Axes::Ours),
        },
    )
}

/// Links for an importer that makes `NavMeshLink` components (Unity, package AI Navigation): the fields of
/// `NavMeshLink` under their names, and further ones.
pub(super) fn unity(set: &LinkSet) -> String {
    /// A vector in the fields that `JsonUtility` reads.
    #[derive(Serialize)]
    struct Vector3 {
        x: Number,
        y: Number,
        z: Number,
    }
    #[derive(Serialize)]
    struct Head<'a> {
        areas: Vec<Kind<'a>>,
    }
    #[derive(Serialize)]
    #[serde(rename_all = "camelCase")]
    struct UnityLink<'a> {
        start_point: Vector3,
        end_point: Vector3,
        /// 0: only the line itself was proved.
        width: f32,
        bidirectional: bool,
        /// Cost of a metre of the link against a metre of walking.
        cost_modifier: f32,
        area: u8,
        about: About<'a>,
    }
    let head = Head { areas: kinds(set, FIRST_UNITY_AREA, LAST_UNITY_AREA) };
    document(
        set,
        Axes::Unity,
        |[x, y, z]| Vector3 { x, y, z },
        head,
        |link, at| UnityLink {
            start_point: at(link.passage.start),
            end_point: at(link.passage.end),
            width: 0.0,
            bidirectional: false,
            cost_modifier: link.cost_ratio(set.speed),
            area: (FIRST_UNITY_AREA + kind_of(link.ability)).min(LAST_UNITY_AREA),
            about: About::of(set, link, Axes::Unity),
        },
    )
}

/// Links in the fields of `FNavigationLink`, the simple links of a `NavLinkProxy` (Unreal Engine), and further ones.
pub(super) fn unreal(set: &LinkSet) -> String {
    #[derive(Serialize)]
    #[serde(rename_all = "PascalCase")]
    struct Vector {
        x: Number,
        y: Number,
        z: Number,
    }
    #[derive(Serialize)]
    struct Head {}
    #[derive(Serialize)]
    #[serde(rename_all = "PascalCase")]
    struct UnrealLink<'a> {
        left: Vector,
        right: Vector,
        /// A value of `ENavLinkDirection`.
        direction: &'static str,
        /// Distance from its ends within which a link joins the NavMesh, cm.
        snap_radius: f32,
        /// Ability: the importer maps it to a class of `UNavArea`.
        area: &'a str,
        /// `FixedAreaEnteringCost` for a link of its own area class, cm of walking.
        entering_cost: f32,
        about: About<'a>,
    }
    let centimetres = Axes::Unreal.units_per_metre();
    document(
        set,
        Axes::Unreal,
        |[x, y, z]| Vector { x, y, z },
        Head {},
        |link, at| UnrealLink {
            left: at(link.passage.start),
            right: at(link.passage.end),
            direction: "LeftToRight",
            snap_radius: set.radius * centimetres,
            area: name_of(set, link.ability),
            entering_cost: link.cost_metres(set.speed) * centimetres,
            about: About::of(set, link, Axes::Unreal),
        },
    )
}

/// Links in the fields of `AnimationLink` of the crate landmass (0.9), and further ones. Its axes, Bevy's, are ours.
pub(super) fn landmass(set: &LinkSet) -> String {
    #[derive(Serialize)]
    struct Head<'a> {
        /// Number of each ability, by which agents permit links.
        kinds: Vec<Kind<'a>>,
    }
    #[derive(Serialize)]
    struct LandmassLink<'a> {
        start_edge: [[Number; 3]; 2],
        end_edge: [[Number; 3]; 2],
        kind: u8,
        /// Cost as the length of a walk, m.
        cost: f32,
        bidirectional: bool,
        about: About<'a>,
    }
    document(
        set,
        Axes::Ours,
        |point| point,
        Head { kinds: kinds(set, 0, u8::MAX) },
        |link, at| {
            let (start, end) = (link.passage.start, link.passage.end);
            let way = end - start;
            let length = hypot(way.x, way.z);
            // Agents enter and leave along edges that extend the link to the ground of a NavMesh that keeps away from
            // ledges.
            let along = if length > 1.0e-3 { Vec3::new(way.x, 0.0, way.z) / length } else { Vec3::X } * LANDMASS_EDGE_M;
            LandmassLink {
                start_edge: [at(start), at(start - along)],
                end_edge: [at(end), at(end + along)],
                kind: kind_of(link.ability),
                cost: link.cost_metres(set.speed),
                bidirectional: false,
                about: About::of(set, link, Axes::Ours),
            }
        },
    )
}

/// Area and flag of an ability: one bit for each, from bit 0; bit 6 for drops.
#[derive(Serialize)]
struct AbilityKey<'a> {
    ability: &'a str,
    area: u8,
    flag: u16,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct OffMeshLinks<'a> {
    #[serde(flatten)]
    frame: FrameFields,
    off_mesh_con_count: usize,
    /// Start and end of each link: count x 6 coordinates, m.
    off_mesh_con_verts: Vec<f32>,
    /// Radius of the ends of each link, m.
    off_mesh_con_rad: Vec<f32>,
    /// Always 0, from start to end only.
    off_mesh_con_dir: Vec<u8>,
    off_mesh_con_areas: Vec<u8>,
    off_mesh_con_flags: Vec<u16>,
    /// Index of each link's edge in the graph's JSON export.
    #[serde(rename = "offMeshConUserID")]
    off_mesh_con_user_id: Vec<u32>,
    /// This field and the following ones are not part of Detour. Area costs can be derived from it.
    off_mesh_con_seconds: Vec<f32>,
    off_mesh_con_chance: Vec<f32>,
    off_mesh_con_driven: Vec<f32>,
    off_mesh_con_leaps: Vec<Vec<Hint<'a>>>,
    legend: Vec<AbilityKey<'a>>,
}

/// Off-mesh connections in the fields of Detour's `dtNavMeshCreateParams`.
pub(super) fn detour(set: &LinkSet) -> String {
    let key = |ability: Ability| AbilityKey {
        ability: name_of(set, ability),
        area: FIRST_DETOUR_AREA + kind_of(ability),
        // Drops have the flag after jetpacks, as they always had.
        flag: match ability.idx() {
            0 => 1 << 6,
            idx @ 1..=6 => 1 << (idx - 1),
            // The body's own moves share the last one.
            idx => 1 << idx.min(15),
        },
    };
    let links = &set.links;
    let abouts: Vec<About<'_>> = links.iter().map(|link| About::of(set, link, Axes::Ours)).collect();
    let keys: Vec<AbilityKey<'_>> = links.iter().map(|link| key(link.ability)).collect();
    let ends = links.iter().flat_map(|link| [link.passage.start, link.passage.end]);
    json(&OffMeshLinks {
        frame: FrameFields::of(set.frame, |origin| origin.to_array()),
        off_mesh_con_count: links.len(),
        off_mesh_con_verts: ends.flat_map(|end| end.to_array()).collect(),
        off_mesh_con_rad: vec![set.radius; links.len()],
        off_mesh_con_dir: vec![0; links.len()],
        off_mesh_con_areas: keys.iter().map(|key| key.area).collect(),
        off_mesh_con_flags: keys.iter().map(|key| key.flag).collect(),
        off_mesh_con_user_id: links.iter().map(|link| link.edge_idx).collect(),
        off_mesh_con_seconds: abouts.iter().map(|about| about.cost_seconds).collect(),
        off_mesh_con_chance: abouts.iter().map(|about| about.chance).collect(),
        off_mesh_con_driven: abouts.iter().map(|about| about.driven).collect(),
        off_mesh_con_leaps: abouts.into_iter().map(|about| about.leaps).collect(),
        legend: abilities(set).map(key).collect(),
    })
}
