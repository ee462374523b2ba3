//! The suites that vary one thing, and measure each value by policy and by plan.

use super::args::Args;
use super::results::Results;
use anyhow::Context;
use std::collections::BTreeMap;
use std::path::PathBuf;
use surefoot_cli::commands::load_policy;
use surefoot_cli::commands::map::load_body;
use surefoot_cli::terminal::with_bar;
use surefoot_eval::conditions::{self, Condition};
use surefoot_eval::{EvalConfig, EvalMap};
use surefoot_policy::Policy;
use surefoot_world::map::{Features, MapKind};
use surefoot_world::{CharacterProfile, MapSpec, RawMapSpec};

/// Subfolder of `--models` with models that differ in their training seed alone.
const SEEDS: &str = "seeds";
/// Densities of devices on the dial, besides none.
const DENSITIES: [f32; 4] = [0.5, 1.0, 2.0, 4.0];
/// Heights of maps, m; others have 80.
const HEIGHTS: [u32; 3] = [40, 120, 200];
/// Bodies besides Surefoot's own.
const BODIES: [&str; 6] = ["unreal", "godot", "unity", "heavy", "small", "climber"];

impl Args {
    /// The policy of suites that measure one.
    fn policy(&self) -> anyhow::Result<Policy> {
        Ok(self.rules.apply(load_policy(self.model.as_deref())?))
    }

    fn conditions(&self, suite: &str, base: &EvalConfig, conditions: &[Condition]) -> anyhow::Result<Results> {
        let settings = self.rules.graph(self.graph.settings()?)?;
        let report = with_bar("evaluating", |bar| {
            conditions::run(suite, conditions, base, settings, |done, total| bar("evaluating", done, total))
        })?;
        Ok(Results::Conditions(report))
    }
}

/// Changes every spec.
fn changed(specs: &[MapSpec], change: impl Fn(&mut RawMapSpec)) -> anyhow::Result<Vec<EvalMap>> {
    specs.iter().map(|spec| Ok(EvalMap::from(spec.with(&change)?))).collect()
}

/// Models that differ only in their training seed, and the shipped models.
pub fn seeds(args: &Args, base: &EvalConfig) -> anyhow::Result<Results> {
    let mut groups: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    let folder = args.models.join(SEEDS);
    let entries = std::fs::read_dir(&folder).with_context(|| format!("cannot read {}", folder.display()))?;
    for entry in entries {
        let path = entry.with_context(|| format!("cannot read {}", folder.display()))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if let Some((group, _)) = name.rsplit_once('-').filter(|_| path.is_dir()) {
            groups.entry(format!("{group}, from scratch")).or_default().push(path);
        }
    }
    for shipped in ["general-reactive", "general-lstm"] {
        groups.insert(format!("shipped {shipped}"), vec![args.models.join(shipped)]);
    }
    let maps: Vec<EvalMap> = args.specs("benchmark")?.into_iter().map(EvalMap::from).collect();
    let condition = |(name, mut folders): (String, Vec<PathBuf>)| -> anyhow::Result<Condition> {
        folders.sort();
        let load = |folder: &PathBuf| load_policy(Some(folder)).map(|policy| args.rules.apply(policy));
        let policies = folders.iter().map(load).collect::<anyhow::Result<_>>()?;
        Ok(Condition { name, policies, maps: maps.clone(), profile: base.profile.clone() })
    };
    let conditions = groups.into_iter().map(condition).collect::<anyhow::Result<Vec<_>>>()?;
    args.conditions("seeds", base, &conditions)
}

/// Maps with fewer and more devices, with and without repair.
pub fn dial(args: &Args, base: &EvalConfig) -> anyhow::Result<Results> {
    let (specs, policies) = (args.specs("5000..5016")?, vec![args.policy()?]);
    // Repair is made of devices, so there is one row without any.
    let dial = std::iter::once((false, 0.0))
        .chain([false, true].into_iter().flat_map(|repair| DENSITIES.map(|density| (repair, density))));
    let condition = |(repair, density)| -> anyhow::Result<Condition> {
        let maps = changed(&specs, |it| {
            (it.repair, it.features.pads, it.features.zip_lines) = (repair, density, density);
        })?;
        let name = match density {
            0.0 => "no devices".to_owned(),
            _ => format!("devices x {density}{}", if repair { ", repaired" } else { "" }),
        };
        Ok(Condition { name, policies: policies.clone(), maps, profile: base.profile.clone() })
    };
    let conditions = dial.map(condition).collect::<anyhow::Result<Vec<_>>>()?;
    args.conditions("dial", base, &conditions)
}

/// All kinds of maps, features, heights and bodies.
pub fn kinds(args: &Args, base: &EvalConfig) -> anyhow::Result<Results> {
    let (specs, policies) = (args.specs("5000..5008")?, vec![args.policy()?]);
    let own = &base.profile;
    let row = |name: String, maps: Vec<EvalMap>, profile: &CharacterProfile| Condition {
        name,
        policies: policies.clone(),
        maps,
        profile: profile.clone(),
    };
    let mut conditions = Vec::new();
    for kind in MapKind::USUAL {
        conditions.push(row(kind.name().to_owned(), changed(&specs, |it| it.kind = kind)?, own));
    }
    for kind in [MapKind::Terrain, MapKind::Open] {
        let maps = changed(&specs, |it| (it.kind, it.features) = (kind, Features::all()))?;
        conditions.push(row(format!("{}, all features", kind.name()), maps, own));
    }
    for height in HEIGHTS {
        conditions.push(row(format!("terrain, {height} m high"), changed(&specs, |it| it.size.height = height)?, own));
    }
    for body in BODIES {
        let profile = load_body(body)?;
        conditions.push(row(format!("terrain, body {body}"), changed(&specs, |_| ())?, &profile));
    }
    args.conditions("kinds", base, &conditions)
}
