//! Places of calls in the level's own coordinates.
//!
//! Services work on maps. Where a call asks for the coordinates of the level, its handler changes the request with
//! [`CallFrame::to_map`] before it decodes it, and the response with [`CallFrame::to_level`] after it has encoded it.
//! [`Places`] says where messages have places. For calls in the coordinates of the map nothing is done.

use crate::convert::{self, FieldError, enum_or};
use crate::planner::v1 as plan;
use crate::world::v1 as wire;
use surefoot_world::Vec3;
use surefoot_world::map::{LevelFrame, UpAxis};

/// Coordinates of the places in a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coordinates {
    /// Those of the map.
    Map,
    /// Those of the level that the map was made from.
    Level,
}

crate::wire_enum!(Coordinates = wire::Coordinates: Map Level);

impl Coordinates {
    /// Reads the field `coordinates` of a request.
    pub fn read(value: i32) -> Result<Self, FieldError> {
        enum_or(value, Self::Map, "coordinates")
    }

    /// These coordinates, in a call about a map with this frame.
    pub fn on(self, frame: &LevelFrame) -> CallFrame {
        CallFrame((self == Self::Level && !frame.is_map()).then_some(*frame))
    }
}

/// A place in the coordinates of its call, whose map is not known yet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    at: Vec3,
    coordinates: Coordinates,
}

impl Place {
    /// Reads a required place and the coordinates of its call.
    pub fn read(value: Option<&wire::Vec3>, coordinates: i32, field: &'static str) -> Result<Self, FieldError> {
        Ok(Self { at: convert::point(value, field)?, coordinates: Coordinates::read(coordinates)? })
    }

    /// The place on a map with this frame, m.
    pub fn on_map(self, frame: &LevelFrame) -> Vec3 {
        match self.coordinates {
            Coordinates::Map => self.at,
            Coordinates::Level => frame.to_map(self.at.as_dvec3()),
        }
    }
}

/// The level whose coordinates a call uses; without one, they are those of the map.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CallFrame(Option<LevelFrame>);

impl CallFrame {
    /// The frame of a call with the field `coordinates`; `frame`, which looks up the frame of the map, is called only
    /// for the coordinates of the level.
    pub fn of<E: From<FieldError>>(coordinates: i32, frame: impl FnOnce() -> Result<LevelFrame, E>) -> Result<Self, E> {
        match Coordinates::read(coordinates)? {
            Coordinates::Map => Ok(Self(None)),
            Coordinates::Level => Ok(Coordinates::Level.on(&frame()?)),
        }
    }

    /// A message of the call, with its places on the map.
    pub fn to_map<M: Places>(&self, mut message: M) -> M {
        if let Some(frame) = &self.0 {
            message.change(&Change { frame, direction: Direction::ToMap });
        }
        message
    }

    /// A message with places on the map, for the caller.
    pub fn to_level<M: Places>(&self, mut message: M) -> M {
        if let Some(frame) = &self.0 {
            message.change(&Change { frame, direction: Direction::ToLevel });
        }
        message
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    ToMap,
    ToLevel,
}

/// A change of coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Change<'a> {
    frame: &'a LevelFrame,
    direction: Direction,
}

impl Change<'_> {
    fn point(&self, point: Vec3) -> Vec3 {
        match self.direction {
            Direction::ToMap => self.frame.to_map(point.as_dvec3()),
            Direction::ToLevel => self.frame.to_level(point).as_vec3(),
        }
    }

    fn places(&self, places: &mut impl Places) {
        places.change(self);
    }

    /// Directions, offsets and velocities.
    fn vectors(&self, vector: &mut Option<wire::Vec3>) {
        let Some(wire::Vec3 { x, y, z }) = *vector else { return };
        let on_axes = Vec3::new(x, y, z);
        *vector = Some(convert::to_wire(match self.direction {
            Direction::ToMap => self.frame.vector_to_map(on_axes.as_dvec3()),
            Direction::ToLevel => self.frame.vector_to_level(on_axes).as_vec3(),
        }));
    }

    /// Points as little-endian floats, three each.
    fn packed(&self, bytes: &mut [u8]) {
        for point in bytes.as_chunks_mut::<12>().0 {
            let numbers = point.as_chunks_mut::<4>().0;
            let [x, y, z] = [0, 1, 2].map(|axis| f32::from_le_bytes(numbers[axis]));
            let point = self.point(Vec3::new(x, y, z)).to_array();
            numbers.iter_mut().zip(point).for_each(|(number, value)| *number = value.to_le_bytes());
        }
    }
}

/// A message with places.
pub trait Places {
    /// Changes the coordinates of all of them.
    fn change(&mut self, change: &Change<'_>);
}

impl Places for Vec3 {
    fn change(&mut self, change: &Change<'_>) {
        *self = change.point(*self);
    }
}

impl Places for wire::Vec3 {
    fn change(&mut self, change: &Change<'_>) {
        *self = convert::to_wire(change.point(Vec3::new(self.x, self.y, self.z)));
    }
}

impl<M: Places> Places for Option<M> {
    fn change(&mut self, change: &Change<'_>) {
        self.iter_mut().for_each(|message| message.change(change));
    }
}

impl<M: Places> Places for Vec<M> {
    fn change(&mut self, change: &Change<'_>) {
        self.iter_mut().for_each(|message| message.change(change));
    }
}

impl Change<'_> {
    /// Changes the lowest and the highest corner of a box.
    fn corners(&self, low: &mut Option<wire::Vec3>, high: &mut Option<wire::Vec3>) {
        low.change(self);
        high.change(self);
        // One axis of a level with z up is opposite to the map's: the lowest corner has its greatest coordinate.
        if let (UpAxis::Z, Some(low), Some(high)) = (self.frame.up, low, high) {
            match self.direction {
                Direction::ToMap => std::mem::swap(&mut low.z, &mut high.z),
                Direction::ToLevel => std::mem::swap(&mut low.y, &mut high.y),
            }
        }
    }
}

impl Places for wire::WatchSegmentsResponse {
    fn change(&mut self, change: &Change<'_>) {
        debug_assert_eq!(change.direction, Direction::ToLevel, "servers send segments");
        self.starts.change(change);
        self.step /= change.frame.scale;
        if change.frame.up == UpAxis::Z {
            for [_, y, z] in self.moves.as_chunks_mut::<3>().0 {
                (*y, *z) = (-*z, *y);
            }
        }
    }
}

impl Places for wire::Region {
    fn change(&mut self, change: &Change<'_>) {
        change.corners(&mut self.low, &mut self.high);
    }
}

impl Places for wire::ZoneBox {
    fn change(&mut self, change: &Change<'_>) {
        change.corners(&mut self.low, &mut self.high);
    }
}

/// Says which fields of messages have places: `places` are points and messages with places, `vectors` have a direction
/// and a length, `packed` are points as bytes.
macro_rules! places {
    ($($message:ty: $($kind:ident $($field:ident)+),+;)*) => {
        $(
            impl Places for $message {
                fn change(&mut self, change: &Change<'_>) {
                    $($(change.$kind(&mut self.$field);)+)+
                }
            }
        )*
    };
}

places! {
    wire::BlockPiece: places foot;
    wire::PlankPiece: places from to;
    wire::PoolPiece: places centre;
    wire::CreateWorldRequest: places pieces zones;
    wire::ZoneCylinder: places bottom;
    wire::SetZonesRequest: places put;
    wire::ListZonesResponse: places zones;
    wire::SurveyMapRequest: places pieces;
    wire::EditMapRequest: places put;
    wire::ListPiecesResponse: places pieces;
    wire::SpawnNpcRequest: places position;
    wire::Spawn: places position goal;
    wire::BatchSpawnNpcsRequest: places spawns;
    wire::SpawnPlayerRequest: places position;
    wire::PlayerMove: places position, vectors velocity;
    wire::TargetMove: places position, vectors velocity;
    wire::MovePlayersRequest: places moves;

    wire::SetGoalResponse: places goal_used;
    wire::SetGoalResult: places goal_used;
    wire::SampleGroundResponse: places points;
    wire::Survey: places cut_off;
    wire::SurveyMapResponse: places surveys;
    wire::PoolFeature: places centre;
    wire::PadFeature: places centre;
    wire::LineFeature: places from to;
    wire::SpotFeature: places from to;
    wire::GetFeaturesResponse: places pools pads zip_lines teleporters jetpacks spots;
    wire::GetMeshResponse: packed positions;
    wire::Mover: places pivot stops, packed positions, vectors belt;
    wire::MoverStop: vectors offset;
    wire::MoverState: places pose;
    wire::ListMoversResponse: places movers states;
    wire::SetMoverResponse: places state;
    wire::Player: places position, vectors velocity;
    wire::Pose: places position;
    wire::Prediction: places in_20_ticks in_40_ticks in_60_ticks;
    wire::Movement: places prediction;
    wire::Npc: places position goal waypoint movement, vectors velocity;
    wire::NpcDelta: places position goal waypoint movement, vectors velocity;
    wire::GetNpcResponse: places npc look_at;
    wire::ListNpcsResponse: places npcs;
    wire::WatchWorldResponse: places npcs changed movers players;
    wire::SegmentStart: places position;
    wire::Spawned: places position;
    wire::AttemptBegan: places goal;
    wire::AttemptEnded: places goal;
    wire::TargetReached: places goal;
    wire::Jumped: places position;
    wire::Landed: places position;
    wire::Rode: places position;
    wire::Died: places position;
    wire::Teleported: places position;
    wire::Stands: places position;
    wire::WatchEventsResponse: places events;
    wire::Ray: places end;
    wire::NpcPlan: places waypoints;
    wire::FollowNpcResponse: places npc plan rays eyes history;

    plan::StartBuildRequest: places pieces;
    plan::PathQuery: places start goal zones;
    plan::Crowd: places place;
    plan::Traffic: places crowds;
    plan::FindPathRequest: places query;
    plan::FindPathsRequest: places queries traffic zones;
    plan::Around: places centre;
    plan::RankPlacesRequest: places query places around hidden_from sees;
    plan::FindReachableRequest: places query;
    plan::EdgeEdit: places from to;
    plan::ForceEdge: places from to;
    plan::PriceEdge: places from to;
    plan::VertexEdit: places at;
    plan::MoveVertex: places from to;
    plan::Layer: places edits;
    plan::PutLayerRequest: places layer;
    plan::AppendEditsRequest: places edits;

    plan::Plan: places waypoints nearest_reachable;
    plan::FindPathResponse: places plan;
    plan::FindPathsResponse: places plans;
    plan::RankedPlace: places place;
    plan::RankPlacesResponse: places places;
    plan::ReachedVertex: places position;
    plan::ReachedCell: places centre;
    plan::FindReachableResponse: places vertices cells;
    plan::GetGraphResponse: places vertices;
    plan::GetLayersResponse: places layers;
    plan::ProbeEdgeResponse: packed track;
}

/// Says which cases of a field have places.
macro_rules! cases {
    ($($message:ty: $field:ident = $($kind:ident)::+: $($case:ident)+;)*) => {
        $(
            impl Places for $message {
                fn change(&mut self, change: &Change<'_>) {
                    use $($kind)::+ as Kind;
                    match &mut self.$field {
                        $(Some(Kind::$case(message)) => message.change(change),)+
                        _ => {}
                    }
                }
            }
        )*
    };
}

cases! {
    wire::Piece: shape = wire::piece::Shape: Block Plank Pool;
    wire::Zone: shape = wire::zone::Shape: Box Cylinder;
    wire::LookTarget: target = wire::look_target::Target: Position;
    wire::NpcEvent: event = wire::npc_event::Event:
        Spawned AttemptBegan AttemptEnded TargetReached Jumped Landed Rode Died Teleported Stands;
    plan::Edit: edit = plan::edit::Edit: ForbidEdge ForceEdge PriceEdge AddVertex MoveVertex RemoveVertex;
}
