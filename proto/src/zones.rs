//! Zones and tags on the wire.

use crate::convert::{self, FieldError};
use crate::world::v1 as wire;
use surefoot_planner::zones::{MAX_ZONES, check_tags};
use surefoot_planner::{Aabb, Rule, Shape, Tags, Zone};

/// Converts zones from the wire; `field` names them.
pub fn list(zones: &[wire::Zone], field: &'static str) -> Result<Vec<Zone>, FieldError> {
    check_count(zones.len(), field)?;
    zones.iter().map(|value| zone(value, field)).collect()
}

/// Checks that there are at most [`MAX_ZONES`] zones.
pub fn check_count(found: usize, field: &'static str) -> Result<(), FieldError> {
    let limit = MAX_ZONES;
    if found > limit { Err(FieldError::Count { field, what: "zones", found, limit }) } else { Ok(()) }
}

fn zone(zone: &wire::Zone, field: &'static str) -> Result<Zone, FieldError> {
    use wire::zone::{Rule as WireRule, Shape as WireShape};
    let shape = match zone.shape.as_ref().ok_or(FieldError::Missing("zone.shape"))? {
        WireShape::Box(value) => Shape::Box(Aabb {
            low: convert::point(value.low.as_ref(), "zone.box.low")?,
            high: convert::point(value.high.as_ref(), "zone.box.high")?,
        }),
        WireShape::Cylinder(value) => {
            let bottom = convert::point(value.bottom.as_ref(), "zone.cylinder.bottom")?;
            Shape::Cylinder { bottom, radius: value.radius, height: value.height }
        }
    };
    let rule = match &zone.rule {
        Some(WireRule::Price(price)) => Rule::Price(*price),
        Some(WireRule::Never(true)) => Rule::Never,
        Some(WireRule::OnlyWithTag(tag)) => Rule::OnlyWith(tag.clone()),
        Some(WireRule::Never(false)) | None => return Err(FieldError::Missing("zone.rule")),
    };
    let concerns = tags(&zone.for_tags, "zone.for_tags")?;
    let read = Zone { name: zone.name.clone(), shape, rule, concerns };
    read.check().map_err(|error| FieldError::Zone { field, name: zone.name.clone(), error })
}

/// Converts a zone to the wire.
pub fn zone_to_wire(zone: &Zone) -> wire::Zone {
    use wire::zone::{Rule as WireRule, Shape as WireShape};
    let shape = match zone.shape {
        Shape::Box(Aabb { low, high }) => {
            WireShape::Box(wire::ZoneBox { low: Some(convert::to_wire(low)), high: Some(convert::to_wire(high)) })
        }
        Shape::Cylinder { bottom, radius, height } => {
            WireShape::Cylinder(wire::ZoneCylinder { bottom: Some(convert::to_wire(bottom)), radius, height })
        }
    };
    let rule = match &zone.rule {
        Rule::Price(price) => WireRule::Price(*price),
        Rule::Never => WireRule::Never(true),
        Rule::OnlyWith(tag) => WireRule::OnlyWithTag(tag.clone()),
    };
    wire::Zone {
        name: zone.name.clone(),
        for_tags: zone.concerns.iter().cloned().collect(),
        shape: Some(shape),
        rule: Some(rule),
    }
}

/// Converts tags from the wire; `field` names them.
pub fn tags(tags: &[String], field: &'static str) -> Result<Tags, FieldError> {
    check_tags(tags.iter().cloned()).map_err(|error| FieldError::Tags { field, error })
}

/// Converts the tags of an NPC to the wire.
pub fn npc_tags_to_wire(npc_id: u64, tags: &Tags) -> wire::NpcTags {
    wire::NpcTags { npc_id, tags: tags.iter().cloned().collect() }
}
