//! Prints the report of an evaluation without a suite.

use surefoot_eval::report::CalibrationBin;
use surefoot_eval::{MapName, Rate, Report};

pub fn print(report: &Report) {
    println!(
        "method {}  model {}  maps {}  {} goals per map, seeds {:?}",
        report.method,
        report.model,
        report.maps.iter().map(MapName::to_string).collect::<Vec<_>>().join(", "),
        report.goals,
        report.seeds
    );
    println!("{:<8}{:>9}{:>19}{:>8}", "goals", "success", "95 % interval", "n");
    let rows = [
        ("all", report.success.all),
        ("easy", report.success.easy),
        ("medium", report.success.medium),
        ("hard", report.success.hard),
    ];
    for (name, Rate { rate, low, high, n }) in rows {
        println!("{name:<8}{:>8.1}%{:>10.1} - {:>5.1}%{n:>8}", 100.0 * rate, 100.0 * low, 100.0 * high);
    }
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    for map in &report.per_map {
        print!(
            "map {}: {} of the goals can be reached; of these {} were, {} died",
            map.map,
            percent(map.reachable),
            percent(map.success_reachable),
            percent(map.died)
        );
        match map.told.zip(map.died_unreachable) {
            Some((told, died)) => println!("; of the others {} were told, {} died", percent(told), percent(died)),
            None => println!(),
        }
        let calibrations = [
            ("promised -> arrived", &map.calibration),
            ("promised -> arrived as planned", &map.calibration_as_planned),
        ];
        for (what, calibration) in calibrations {
            let Some(calibration) = calibration else { continue };
            let bin = |it: &CalibrationBin| format!("{} -> {} ({})", percent(it.promised), percent(it.arrived), it.n);
            let bins: Vec<String> = calibration.bins.iter().map(bin).collect();
            println!("    {what}: {}; Brier score {:.3}", bins.join(", "), calibration.brier);
        }
    }
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
    let ends: Vec<String> = report.ends.iter().map(|(end, count)| format!("{end} {count}")).collect();
    println!("ends: {}", ends.join(", "));
    if !report.faults.is_empty() {
        let faults: Vec<String> = report.faults.iter().map(|(fault, count)| format!("{fault} {count}")).collect();
        println!("failures by plan: {}", faults.join(", "));
    }
    println!(
        "mean time to goal {:.1} s, straight-line distance over distance covered {:.2}, re-plans per attempt {:.2}",
        report.seconds_to_goal, report.directness, report.replans
    );
    let motion = &report.motion;
    println!(
        "motion: {:.2} reversals/s, facing off by {:.0} degrees (median) and {:.0} (p90), {:.2} jumps per 100 m, {:.2} on legs that can be walked ({:.0} % of the way), in the air {} and {} of the time, jerk {:.0} m/s3",
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
    if let Some(graph) = &report.graph {
        println!(
            "graph: {:.0} vertices, {:.0} edges, {:.1} islands, {:.1} % of vertex pairs connected, {:.0} probes of {:.0} candidates in {:.1} s, search {:.1} us (median), attempts {:.0} s",
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
}
