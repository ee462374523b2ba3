//! Tests of the batch protocol through the public API: a bridge to games that follow docs/reference/game-protocol.md,
//! and to games that do not. The bytes are written by hand here, as a game in another language would.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use surefoot_game::{Action, Bridge, BridgeError, CharacterProfile, End, Vec3};
use surefoot_game_client::{Game, GameEnv, GameError, Level};
use surefoot_levels::ImportOptions;
use surefoot_net::client::Credentials;
use surefoot_rollout::Goal;
use surefoot_rollout::env::Route;
use surefoot_world::{Ability, Map};

const HELLO: u32 = 1;
const OPEN: u32 = 2;
const PLACES: u32 = 3;
const DECIDE: u32 = 4;

/// Changes the header and body of an answer to a message of a kind before it is sent. An empty result closes the
/// connection.
type Fault = fn(u32, &mut Vec<u8>);

/// What a game has seen.
#[derive(Debug, Default)]
struct Seen {
    decisions: AtomicUsize,
    /// The bodies of the messages that open worlds.
    opened: Mutex<Vec<Vec<u8>>>,
}

/// A game whose characters go where they want through everything, and see ground 2 m away with their first ray alone.
struct Peer {
    uri: String,
    seen: Arc<Seen>,
}

impl Peer {
    fn start(fault: Fault) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let uri = format!("tcp://{}", listener.local_addr().expect("an address"));
        let seen = Arc::<Seen>::default();
        let shared = seen.clone();
        std::thread::spawn(move || {
            for connection in listener.incoming().flatten() {
                let seen = shared.clone();
                std::thread::spawn(move || serve(connection, &seen, fault));
            }
        });
        Self { uri, seen }
    }

    fn sound() -> Self {
        Self::start(|_, _| {})
    }
}

/// Serves a connection until it ends.
fn serve(mut connection: TcpStream, seen: &Seen, fault: Fault) -> Option<()> {
    let mut feet: Vec<[f32; 3]> = Vec::new();
    loop {
        let mut header = [0; 8];
        connection.read_exact(&mut header).ok()?;
        let kind = int(&header, 0);
        let mut body = vec![0; int(&header, 4) as usize];
        connection.read_exact(&mut body).ok()?;
        let answer = match kind {
            HELLO => body,
            OPEN => {
                feet = vec![[0.0; 3]; int(&body, 0) as usize];
                seen.opened.lock().unwrap().push(body);
                Vec::new()
            }
            PLACES => [[1.0f32, 0.0, 1.0], [40.0, 0.0, 40.0]].concat().into_iter().flat_map(f32::to_le_bytes).collect(),
            _ => {
                seen.decisions.fetch_add(1, Ordering::Relaxed);
                decide(&body, &mut feet)
            }
        };
        let mut message = [kind.to_le_bytes(), (answer.len() as u32).to_le_bytes()].concat();
        message.extend(answer);
        fault(kind, &mut message);
        let is_whole = message.len() >= 8 && message.len() == 8 + int(&message, 4) as usize;
        connection.write_all(&message).ok()?;
        if !is_whole {
            return None;
        }
    }
}

fn int(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(int(bytes, at))
}

/// Ten ticks, in which characters move by 0.1 m times their first two values, along z and x; then placements.
fn decide(body: &[u8], feet: &mut [[f32; 3]]) -> Vec<u8> {
    let (acting, placing) = (int(body, 0) as usize, int(body, 4) as usize);
    assert_eq!(body.len(), 8 + 20 * (acting + placing));
    let mut answer = Vec::new();
    let state = |answer: &mut Vec<u8>, feet: [f32; 3], flags: u32| {
        let values = [feet[0], feet[1], feet[2], 0.0, 0.0, 0.0, 0.0, 0.0];
        answer.extend(values.into_iter().flat_map(f32::to_le_bytes));
        answer.extend(flags.to_le_bytes());
    };
    let hits = |answer: &mut Vec<u8>| {
        let distances = (0..64).map(|ray| if ray == 0 { 2.0f32 } else { 0.0 });
        answer.extend(distances.flat_map(f32::to_le_bytes));
        answer.extend((0..64).map(|ray| if ray == 0 { 0 } else { 255 }));
    };
    for at in (0..acting).map(|idx| 8 + 20 * idx) {
        let it = &mut feet[int(body, at) as usize];
        let jumps = float(body, at + 16) > 0.0;
        for tick in 0..10 {
            it[2] += 0.1 * float(body, at + 4);
            it[0] += 0.1 * float(body, at + 8);
            // On the ground, can jump, has jumped.
            state(&mut answer, *it, 3 | u32::from(jumps && tick == 0) << 8);
        }
        hits(&mut answer);
    }
    for at in (0..placing).map(|idx| 8 + 20 * (acting + idx)) {
        let it = [float(body, at + 4), float(body, at + 8), float(body, at + 12)];
        feet[int(body, at) as usize] = it;
        state(&mut answer, it, 3);
        hits(&mut answer);
    }
    answer
}

fn level() -> Level {
    let bytes = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/boxes.obj")).expect("the level");
    let options = ImportOptions::default();
    let map: Map = surefoot_levels::import_obj(&bytes, None, &options).expect("a level").map;
    Level { map: Arc::new(map), body: CharacterProfile::default(), solid_npcs: false }
}

/// Connects over a bridge, as `--world` does.
fn connect(uri: &str) -> Game {
    let bridge = Bridge::start(uri).expect("the game says hello");
    let game = Game::connect(bridge.uri(), &Credentials::default()).expect("the bridge serves");
    game.behind(uri, bridge)
}

const STILL: Action = Action { forward: 0.0, strafe: 0.0, turn: 0.0, jump: 0.0 };

fn goal(x: f32) -> Goal {
    Goal { start: Vec3::new(x, 1.0, 0.0), yaw: 0.0, goal: Vec3::new(x, 1.0, 50.0) }
}

fn two_npcs(peer: &Peer) -> GameEnv {
    connect(&peer.uri).open(&level(), &[goal(5.0), goal(9.0)]).expect("a sound game")
}

#[test]
fn a_decision_of_all_npcs_with_new_starts_takes_one_round_trip() {
    let peer = Peer::sound();
    let mut env = two_npcs(&peer);
    assert_eq!(peer.seen.decisions.load(Ordering::Relaxed), 1, "all are placed at once");
    assert_eq!(env.state().positions, [Vec3::new(5.0, 1.0, 0.0), Vec3::new(9.0, 1.0, 0.0)]);
    let ahead = Action { forward: 1.0, jump: 1.0, ..STILL };
    let start = Vec3::new(20.0, 1.0, 20.0);
    let route = Route { npc_idx: 0, start: Some((start, 0.5)), waypoints: vec![start, Vec3::ZERO] };
    let state = env.step(&[ahead, STILL], &[route]).unwrap();
    assert_eq!(state.positions, [start, Vec3::new(9.0, 1.0, 0.0)]);
    assert_eq!(state.abilities, [Ability::JUMP, Ability::WALK], "what it did before it was put elsewhere");
    // 2 m of 30 m, by the first ray alone.
    assert!((state.observations[0] - (1.0 - 2.0 / 30.0)).abs() < 1.0e-6 && state.observations[1] == 0.0);
    let state = env.step(&[STILL, ahead], &[]).unwrap();
    assert_eq!((state.passed.as_slice(), state.ended.as_slice()), (&[1, 0][..], &[None, None][..]));
    assert!((state.positions[1].z - 1.0).abs() < 1.0e-5, "ten ticks of 0.1 m: {}", state.positions[1]);
    assert_eq!(peer.seen.decisions.load(Ordering::Relaxed), 3);
}

#[test]
fn a_world_is_opened_with_the_body_and_the_rays() {
    let peer = Peer::sound();
    let _env = two_npcs(&peer);
    let opened = peer.seen.opened.lock().unwrap();
    let body = &opened[0];
    assert_eq!((body.len(), int(body, 0)), (852, 2));
    assert_eq!([4, 8, 12].map(|at| float(body, at)), [1.8, 0.3, 11.0], "height, radius, forward speed");
    assert!((float(body, 76) - 0.85 * 1.8).abs() < 1.0e-6 && float(body, 80) == 30.0, "eye and range");
    for at in (0..64).map(|ray| 84 + 12 * ray) {
        let ray = Vec3::new(float(body, at), float(body, at + 4), float(body, at + 8));
        assert!((ray.length() - 1.0).abs() < 1.0e-5 && ray.z > 0.0, "{ray}");
    }
}

#[test]
fn endless_episodes_begin_where_the_game_has_places() {
    let peer = Peer::sound();
    let game = connect(&peer.uri);
    let env = game.open_endless(&level(), 3, (0.0, 100.0), 7).expect("a sound game");
    let places = [Vec3::new(1.0, 0.0, 1.0), Vec3::new(40.0, 0.0, 40.0)];
    assert!(env.state().positions.iter().all(|at| places.contains(at)), "{:?}", env.state().positions);
}

#[test]
fn npcs_that_came_to_harm_end_and_rest_until_they_are_placed() {
    // Both fall in the first tick of a decision in which two act.
    let peer = Peer::start(|kind, message| {
        if kind == DECIDE && message.len() == 8 + 2 * 680 {
            message[8 + 34] = 1;
            message[8 + 680 + 34] = 1;
        }
    });
    let mut env = two_npcs(&peer);
    let state = env.step(&[STILL; 2], &[]).unwrap();
    assert_eq!(state.ended, [Some(End::Fell); 2]);
    let state = env.step(&[STILL; 2], &[]).unwrap();
    assert_eq!(state.ended, [None; 2]);
    assert_eq!(peer.seen.decisions.load(Ordering::Relaxed), 2, "nobody acts, so nothing is sent");
}

/// Takes three steps with one NPC.
fn try_out(uri: &str) -> Result<(), GameError> {
    let mut env = connect(uri).open(&level(), &[goal(5.0)])?;
    (0..3).try_for_each(|_| env.step(&[STILL], &[]).map(drop))
}

/// Overwrites four bytes of the answer of a decision in which one NPC acts, or of any other kind.
fn poke(kind: u32, message: &mut [u8], (wanted, at): (u32, usize), bytes: [u8; 4]) {
    if kind == wanted && (kind != DECIDE || message.len() == 8 + 680) {
        message[at..at + 4].copy_from_slice(&bytes);
    }
}

#[test]
fn games_that_speak_nonsense_are_told_so_in_a_line() {
    let faults: [(Fault, &str); 12] = [
        (|kind, message| poke(kind, message, (OPEN, 0), [9, 0, 0, 0]), "of kind open with kind 9"),
        (|kind, message| poke(kind, message, (OPEN, 4), [255; 4]), "kind open has 4294967295 bytes, expected 0"),
        (
            |kind, message| {
                if kind == OPEN {
                    *message = [&[0, 0, 0, 0, 6, 0, 0, 0], &b"no\nnpc"[..]].concat();
                }
            },
            "refuses a message of kind open: nonpc",
        ),
        (|kind, message| poke(kind, message, (DECIDE, 4), [1, 0, 0, 0]), "decide has 1 bytes, expected 680"),
        (
            |kind, message| poke(kind, message, (DECIDE, 12), f32::NAN.to_le_bytes()),
            "feet or velocity that are not finite",
        ),
        (
            |kind, message| poke(kind, message, (DECIDE, 32), f32::INFINITY.to_le_bytes()),
            "yaw or fuel that are not finite",
        ),
        (|kind, message| poke(kind, message, (DECIDE, 40), [0, 0, 9, 0]), "harm 9; it must be 0 to 3"),
        (|kind, message| poke(kind, message, (DECIDE, 40), [0x20, 0, 0, 0]), "flags 0x20; bits 4 to 7"),
        (
            |kind, message| poke(kind, message, (DECIDE, 368), 31.0f32.to_le_bytes()),
            "ray 0 of character 0 hits after 31 m",
        ),
        (
            |kind, message| poke(kind, message, (DECIDE, 624), [7, 255, 255, 255]),
            "hits surface 7; it must be 0 to 6 or 255",
        ),
        (
            |kind, message| {
                if kind == DECIDE && message.len() == 8 + 680 {
                    message.truncate(300);
                }
            },
            "closed the connection during a message of kind decide",
        ),
        (
            |kind, message| {
                if kind == DECIDE && message.len() == 8 + 680 {
                    message.clear();
                }
            },
            "closed the connection during a message of kind decide",
        ),
    ];
    for (fault, words) in faults {
        let peer = Peer::start(fault);
        let error = try_out(&peer.uri).expect_err(words).to_string();
        assert!(error.contains(words) && error.contains(&peer.uri) && !error.contains('\n'), "{words}: {error}");
    }
    try_out(&Peer::sound().uri).expect("a sound game");
}

#[test]
fn there_is_no_bridge_to_what_says_no_hello() {
    let faults: [(Fault, &str); 4] = [
        (|_, message| message[8] = b'X', "its hello does not begin with SFGW"),
        (|_, message| message[12] = 2, "its hello says 2 version, expected 1"),
        (|_, message| *message = b"HTTP/1.1 400 Bad Request".to_vec(), "it does not speak the protocol"),
        (|_, message| message.clear(), "it closed the connection during a message of kind hello"),
    ];
    for (fault, words) in faults {
        let error = Bridge::start(&Peer::start(fault).uri).expect_err(words).to_string();
        assert!(error.starts_with("cannot use the game at tcp://127.0.0.1:") && error.contains(words), "{error}");
    }
    let nobody = Bridge::start("tcp://127.0.0.1:9").expect_err("nobody listens");
    assert!(matches!(nobody, BridgeError::Game { .. }), "{nobody}");
    let form = Bridge::start("ftp://127.0.0.1").expect_err("of another form").to_string();
    assert_eq!(form, "ftp://127.0.0.1 is no address of a game: it must be tcp://HOST:PORT or unix:PATH");
}
