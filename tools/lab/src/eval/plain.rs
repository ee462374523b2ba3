//! Prints the report of an evaluation without a suite.

use std::collections::BTreeMap;
use surefoot_eval::report::{CalibrationBin, MapReport, MotionReport};
use surefoot_eval::unit::GraphFigures;
use surefoot_eval::{MapName, Rate, Report, Success};

pub fn print(report: &Report) {
    println!(
        "method {}  model {}  maps {}  {} goals per map, seeds {:?}",
        report.method,
        report.model,
        report.maps.iter().map(MapName::to_string).collect::<Vec<_>>().join(", "),
        report.goals,
        report.seeds
    );
    print_success(&report.success);
    report.per_map.iter().for_each(print_map);
    if let Some(by_map) = report.by_map {
        println!(
            "over {} maps: {} % with its 95 % interval; standard deviation between maps {:.1} points",
            by_map.maps,
            by_map.percent(),
            100.0 * by_map.between_maps
        );
    }
    if let Some(spread) = report.spread {
        println!("spread between seeds {:.2} points", 100.0 * spread);
    }
    println!("ends: {}", counts(&report.ends));
    if !report.faults.is_empty() {
        println!("failures by plan: {}", counts(&report.faults));
    }
    println!(
        "mean time to goal {:.1} s, straight-line distance over distance covered {:.2}, re-plans per attempt {:.2}",
        report.seconds_to_goal, report.directness, report.replans
    );
    print_motion(&report.motion);
    if let Some(graph) = &report.graph {
        print_graph(graph);
    }
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

fn counts(counts: &BTreeMap<String, usize>) -> String {
    counts.iter().map(|(name, count)| format!("{name} {count}")).collect::<Vec<_>>().join(", ")
}

fn print_success(success: &Success) {
    println!("{:<8}{:>9}{:>19}{:>8}", "goals", "success", "95 % interval", "n");
    let rows = [("all", success.all), ("easy", success.easy), ("medium", success.medium), ("hard", success.hard)];
    for (name, Rate { rate, low, high, n }) in rows {
        println!("{name:<8}{:>8.1}%{:>10.1} - {:>5.1}%{n:>8}", 100.0 * rate, 100.0 * low, 100.0 * high);
    }
}

fn print_map(map: &MapReport) {
    print!(
        "map {}: {} of the goals are reachable; {} of these were reached, {} died",
        map.map,
        percent(map.reachable),
        percent(map.success_reachable),
        percent(map.died)
    );
    if let Some(share) = map.playable {
        print!("; goals come from the playable area, {} of the ground", percent(share));
    }
    if let Some((reported, died)) = map.told.zip(map.died_unreachable) {
        print!("; {} of the unreachable goals were reported, {} died", percent(reported), percent(died));
    }
    match map.plans_unreachable.zip(map.seconds_unreachable) {
        Some((plans, seconds)) => println!(", after {plans:.0} plans and {seconds:.1} s (medians)"),
        None => println!(),
    }
    let calibrations =
        [("promised -> arrived", &map.calibration), ("promised -> arrived as planned", &map.calibration_as_planned)];
    for (what, calibration) in calibrations {
        let Some(calibration) = calibration else { continue };
        let bin = |it: &CalibrationBin| format!("{} -> {} ({})", percent(it.promised), percent(it.arrived), it.n);
        let bins: Vec<String> = calibration.bins.iter().map(bin).collect();
        println!("    {what}: {}; Brier score {:.3}", bins.join(", "), calibration.brier);
    }
}

fn print_motion(motion: &MotionReport) {
    println!(
        "motion: {:.2} reversals/s, facing off by {:.0} degrees (median) and {:.0} (p90), {:.2} jumps per 100 m, \
         {:.2} on legs that can be walked ({:.0} % of the way), in the air {} and {} of the time, jerk {:.0} m/s3",
        motion.reversals_per_s,
        motion.facing_p50_deg,
        motion.facing_p90_deg,
        motion.jumps_per_100m,
        motion.walk_jumps_per_100m,
        100.0 * motion.walk_share,
        percent(motion.air_share),
        percent(motion.walk_air_share),
        motion.jerk,
    );
}

fn print_graph(graph: &GraphFigures) {
    println!(
        "graph: {:.0} vertices, {:.0} edges, {:.1} islands, {:.1} % of vertex pairs connected, \
         {:.0} probes of {:.0} candidates in {:.1} s, search {:.1} us (median), attempts {:.0} s",
        graph.vertices,
        graph.edges,
        graph.islands,
        100.0 * graph.connected,
        graph.probes,
        graph.candidates,
        graph.build_s,
        graph.search_us_median,
        graph.eval_s,
    );
}
