//! Newtypes for units, counts and indices that cross modules, so that the compiler distinguishes them.

use crate::DECISION_SECONDS;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::{Add, Mul};

/// A point in the time of a world: ticks stepped since the world began, 1/60 s each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub struct Tick(pub u64);

impl Tick {
    /// Ticks since `earlier`; 0 if `earlier` is later.
    pub fn since(self, earlier: Tick) -> u64 {
        self.0.saturating_sub(earlier.0)
    }
}

impl Add<u64> for Tick {
    type Output = Self;

    fn add(self, ticks: u64) -> Self {
        Self(self.0 + ticks)
    }
}

impl fmt::Display for Tick {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Seed of a pseudo-random number generator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub struct Seed(pub u64);

impl From<u64> for Seed {
    fn from(value: u64) -> Self {
        Self(value)
    }
}

impl fmt::Display for Seed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Index of a mover on its map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub struct MoverId(pub u16);

impl MoverId {
    /// Place of the mover in the list of the map.
    pub fn idx(self) -> usize {
        usize::from(self.0)
    }
}

/// Index of one of a mover's stops.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub struct StopIdx(pub u8);

impl StopIdx {
    /// Place of the stop in the list of its mover.
    pub fn idx(self) -> usize {
        usize::from(self.0)
    }
}

/// A mover at one of its stops.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct MoverAt {
    /// The mover.
    pub mover: MoverId,
    /// Its stop.
    pub stop: StopIdx,
}

/// A set of the stops of one mover.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub struct StopSet(pub u16);

impl StopSet {
    /// All stops that a mover can have.
    pub const ALL: Self = Self(u16::MAX);

    /// The first `count` stops, at most 16.
    pub fn first(count: usize) -> Self {
        Self(((1u32 << count) - 1) as u16)
    }

    /// One stop; none if its index is 16 or more.
    pub fn only(stop: StopIdx) -> Self {
        Self(1u16.checked_shl(stop.0.into()).unwrap_or(0))
    }

    /// Whether the set is empty.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether the set has a stop.
    pub fn contains(self, stop: StopIdx) -> bool {
        !self.intersection(Self::only(stop)).is_empty()
    }

    /// The stops of both sets.
    pub fn intersection(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// The stops of this set that `other` lacks.
    pub fn difference(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// The lowest stop; `None` if the set is empty.
    pub fn lowest(self) -> Option<StopIdx> {
        (!self.is_empty()).then(|| StopIdx(self.0.trailing_zeros() as u8))
    }
}

/// A probability, in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize)]
pub struct Chance(f64);

impl Chance {
    /// The probability 1.
    pub const CERTAIN: Self = Self(1.0);

    /// The nearest probability to `value`; 0 for NaN.
    pub fn new(value: f64) -> Self {
        Self(if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) })
    }

    /// The probability as a number in [0, 1].
    pub fn get(self) -> f64 {
        self.0
    }
}

impl Mul for Chance {
    type Output = Self;

    /// The chance that both of two independent events happen.
    fn mul(self, other: Self) -> Self {
        Self(self.0 * other.0)
    }
}

impl std::iter::Product for Chance {
    fn product<I: Iterator<Item = Self>>(chances: I) -> Self {
        chances.fold(Self::CERTAIN, Mul::mul)
    }
}

/// A non-negative duration in decisions; fractional, because means and estimates are.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default, Serialize, Deserialize)]
pub struct Decisions(pub f64);

impl Decisions {
    /// The same duration in seconds.
    pub fn seconds(self) -> Seconds {
        Seconds(self.0 as f32 * DECISION_SECONDS)
    }
}

/// A duration in seconds.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default, Serialize, Deserialize)]
pub struct Seconds(pub f32);

impl Seconds {
    /// The same duration in decisions.
    pub fn decisions(self) -> Decisions {
        Decisions(f64::from(self.0 / DECISION_SECONDS))
    }
}

impl Add for Seconds {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl std::iter::Sum for Seconds {
    fn sum<I: Iterator<Item = Self>>(durations: I) -> Self {
        durations.fold(Self(0.0), Add::add)
    }
}
