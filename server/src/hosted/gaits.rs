//! How gaits are saved: with all their values, after a speed with the sign of a minus. Saves of worlds up to version 13
//! and journals up to version 6 have only two values, speed and acceleration, and no sign.

use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use surefoot_world::Gait;

/// Number of values of a gait.
const VALUE_COUNT: usize = 5;

/// Writes a gait.
pub fn serialize<S: Serializer>(gait: &Gait, serializer: S) -> Result<S::Ok, S::Error> {
    let Gait { speed, acceleration, turn_rate, wall_distance, avoids_jumps } = *gait;
    (-speed, acceleration, turn_rate, wall_distance, avoids_jumps).serialize(serializer)
}

/// Reads a gait of either form.
///
/// # Errors
/// If there are too few values.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Gait, D::Error> {
    deserializer.deserialize_tuple(VALUE_COUNT, Values)
}

struct Values;

impl<'de> Visitor<'de> for Values {
    type Value = Gait;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a gait")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut values: A) -> Result<Gait, A::Error> {
        let (speed, acceleration): (f32, f32) = (next(&mut values)?, next(&mut values)?);
        let former = Gait { speed, acceleration, ..Gait::DEFAULT };
        if speed.is_sign_positive() {
            return Ok(former);
        }
        let (turn_rate, wall_distance) = (next(&mut values)?, next(&mut values)?);
        Ok(Gait { speed: -speed, turn_rate, wall_distance, avoids_jumps: next(&mut values)?, ..former })
    }
}

fn next<'de, A: SeqAccess<'de>, T: Deserialize<'de>>(values: &mut A) -> Result<T, A::Error> {
    values.next_element()?.ok_or_else(|| A::Error::custom("a gait has more values"))
}
