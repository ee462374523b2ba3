//! The capacity model: the cost of each part as a straight line through the recorded load, and the size of a fleet that
//! follows from it.

use super::load::Load;
use super::record_load::RecordLoad;
use crate::bench::{Figure, line_through};
use anyhow::ensure;

/// Ticks of a world in a second.
pub const TICKS_PER_S: f64 = 60.0;
/// Decisions of an NPC in a second.
pub const DECISIONS_PER_S: f64 = 6.0;

/// Cores of the database.
const CORES_OF_RECORD: usize = 4;

/// CPU time that grows with the number of NPCs: `fixed + each * npcs`.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// Cost without NPCs.
    pub fixed: f64,
    /// Cost of each NPC.
    pub each: f64,
}

impl Line {
    /// The least-squares line through (NPCs, value); neither part is negative.
    fn through(points: &[[f64; 2]]) -> Self {
        let [fixed, each] = line_through(points).map(|part| part.max(0.0));
        Self { fixed, each }
    }

    /// The value for a number of NPCs.
    pub fn at(self, npcs: f64) -> f64 {
        self.fixed + self.each * npcs
    }
}

/// The costs of the parts of a fleet.
#[derive(Debug, Clone)]
pub struct Model {
    /// CPU time of a server for a tick of a world, by its NPCs, us.
    pub tick_us: Line,
    /// CPU time of a worker for a decision, us.
    pub decision_us: f64,
    /// CPU time of a planner for a plan, us.
    pub plan_us: f64,
    /// Plans of an NPC in a second.
    pub plans_per_s: f64,
    /// Bytes of an NPC in a second: from the workers to the server and back, from the workers to the planner and back.
    pub bytes_per_s: [[f64; 2]; 2],
    /// Worlds for each server, as recorded.
    pub worlds: usize,
    /// The load on the database.
    pub record: RecordLoad,
}

/// A fleet.
#[derive(Debug, Clone, Copy)]
pub struct Fleet {
    /// Number of servers.
    pub servers: usize,
    /// Cores of each server.
    pub server_cores: usize,
    /// NPCs of each server.
    pub npcs: usize,
    /// Workers, each of one core.
    pub workers: usize,
    /// Planners, each of one core.
    pub planners: usize,
    /// Cores of the database.
    pub record_cores: usize,
    /// Whether all parts share the cores of the one server.
    pub shares_cores: bool,
}

impl Fleet {
    /// The smallest fleet whose workers and planners are busy for at most `share` of the time.
    pub fn planned(model: &Model, servers: usize, server_cores: usize, npcs: usize, share: f64) -> Self {
        let all = (servers * npcs) as f64;
        let [_, worker, planner] = model.cores(all, (servers * model.worlds) as f64);
        let count = |cores: f64| ((cores / share).ceil() as usize).max(1);
        Self {
            servers,
            server_cores,
            npcs,
            workers: count(worker),
            planners: count(planner),
            record_cores: CORES_OF_RECORD,
            shares_cores: false,
        }
    }

    /// The recorded deployment: all parts on the same cores.
    pub fn on_one_machine(load: &Load, npcs: usize) -> Self {
        let (servers, workers, planners) = (1, 1, 1);
        Self { servers, server_cores: load.cores, npcs, workers, planners, record_cores: 1, shares_cores: true }
    }
}

/// Utilisation of the parts of a fleet, 0 to 1.
#[derive(Debug, Clone, Copy)]
pub struct Shares {
    pub server: f64,
    pub worker: f64,
    pub planner: f64,
    pub record: f64,
}

impl Model {
    /// The model of a recorded load.
    pub fn of(load: &Load) -> anyhow::Result<Self> {
        ensure!(
            load.rungs.len() >= 2,
            "a recorded load needs at least two numbers of NPCs, this one has {}",
            load.rungs.len()
        );
        let sum = |of: &dyn Fn(&super::load::Rung) -> f64| load.rungs.iter().map(of).sum::<f64>();
        let npc_seconds = sum(&|rung| rung.npcs as f64 * rung.seconds);
        let tick = |rung: &super::load::Rung| {
            let ticks = rung.worlds as f64 * rung.seconds * TICKS_PER_S;
            [rung.npcs as f64 / rung.worlds as f64, 1e6 * rung.cpu_s[0] / ticks]
        };
        let ticks: Vec<[f64; 2]> = load.rungs.iter().map(tick).collect();
        let bytes = |link: usize, way: usize| sum(&|rung| rung.bytes[link][way] as f64) / npc_seconds;
        Ok(Self {
            tick_us: Line::through(&ticks),
            decision_us: 1e6 * sum(&|rung| rung.cpu_s[1]) / sum(&|rung| rung.decisions as f64).max(1.0),
            plan_us: 1e6 * sum(&|rung| rung.cpu_s[2]) / sum(&|rung| rung.plans).max(1.0),
            plans_per_s: sum(&|rung| rung.plans) / npc_seconds,
            bytes_per_s: [[bytes(0, 0), bytes(0, 1)], [bytes(1, 0), bytes(1, 1)]],
            worlds: load.rungs[0].worlds,
            record: load.record,
        })
    }

    /// Cores that servers, workers and planners need for `npcs` NPCs on `worlds` worlds.
    pub fn cores(&self, npcs: f64, worlds: f64) -> [f64; 3] {
        let ticks_us = TICKS_PER_S * worlds * self.tick_us.at(npcs / worlds);
        let decisions_us = npcs * DECISIONS_PER_S * self.decision_us;
        [ticks_us / 1e6, decisions_us / 1e6, npcs * self.plans_per_s * self.plan_us / 1e6]
    }

    /// Writes to the database per second, from these numbers of servers, worlds and processes.
    pub fn writes_per_s(&self, servers: f64, worlds: f64, processes: f64) -> f64 {
        let RecordLoad { save_every_s, renew_every_s, notes_per_s, .. } = self.record;
        worlds / save_every_s + servers * notes_per_s + processes / renew_every_s
    }

    /// How busy the parts of a fleet are.
    pub fn shares(&self, fleet: &Fleet) -> Shares {
        let worlds = (fleet.servers * self.worlds) as f64;
        let [server, worker, planner] = self.cores((fleet.servers * fleet.npcs) as f64, worlds);
        let writes = self.writes_per_s(fleet.servers as f64, worlds, (fleet.servers + fleet.planners) as f64);
        Shares {
            server: server / (fleet.servers * fleet.server_cores) as f64,
            worker: worker / fleet.workers as f64,
            planner: planner / fleet.planners as f64,
            record: writes * self.record.cpu_us_per_write / 1e6 / fleet.record_cores as f64,
        }
    }

    /// Prints the costs of the parts.
    pub fn print(&self) {
        let [work, plans] = self.bytes_per_s;
        eprintln!(
            "a tick takes {:.1} us + {:.3} us for each NPC; a decision {:.1} us; a plan {:.0} us, {:.3} plans/s for \
             each NPC\n\
             bytes/s for each NPC: server to workers {:.0}, back {:.0}; workers to planners {:.0}, back {:.0}",
            self.tick_us.fixed,
            self.tick_us.each,
            self.decision_us,
            self.plan_us,
            self.plans_per_s,
            work[1],
            work[0],
            plans[0],
            plans[1],
        );
    }

    /// Prints the sizes of fleets of up to a million NPCs, with `per_server` NPCs per server.
    pub fn print_fleets(&self, per_server: usize) {
        eprintln!("\nfleets with 128 NPCs on a world and {per_server} on a server");
        for npcs in [1e3, 1e4, 1e5, 1e6] {
            let worlds = npcs / 128.0;
            let servers = (npcs / per_server as f64).ceil();
            let [server, worker, planner] = self.cores(npcs, worlds);
            let (saves, each) = (worlds / self.record.save_every_s, self.record.save_bytes);
            let writes = self.writes_per_s(servers, worlds, servers + planner.ceil());
            eprintln!(
                "{npcs:>9} NPCs, {servers} servers: cores busy of servers {server:.1}, workers {worker:.1}, planners \
                 {planner:.2}; {:.1} Mbit/s to workers; {writes:.0} writes/s to the database, which take {:.2} cores; \
                 {saves:.0} blobs/s and {:.1} MB/s to the object store",
                8e-6 * npcs * self.bytes_per_s[0][1],
                writes * self.record.cpu_us_per_write / 1e6,
                1e-6 * saves * (each[0] + each[1] * 128.0),
            );
        }
    }

    /// The model as figures.
    pub fn figures(&self) -> Vec<Figure> {
        let [server, worker, planner] = self.cores(1000.0, 1000.0 / 128.0);
        vec![
            Figure::new("tick_us", self.tick_us.fixed, "us"),
            Figure::new("tick_us_per_npc", self.tick_us.each, "us"),
            Figure::new("decision_us", self.decision_us, "us"),
            Figure::new("plan_us", self.plan_us, "us"),
            Figure::new("plans_s_per_npc", self.plans_per_s, "plans/s"),
            Figure::new("server_cores_per_1000", server, "cores"),
            Figure::new("worker_cores_per_1000", worker, "cores"),
            Figure::new("planner_cores_per_1000", planner, "cores"),
            Figure::new("worker_bytes_s_per_npc", self.bytes_per_s[0].iter().sum(), "bytes/s"),
        ]
    }
}
