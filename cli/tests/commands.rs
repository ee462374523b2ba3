//! The command as users run it, in real processes.

use std::process::{Command, Output, Stdio};

fn surefoot(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_surefoot")).args(args).output().expect("the command runs")
}

fn json(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON document on stdout")
}

#[test]
fn addresses_that_the_page_could_not_be_allowed_to_call_are_refused() {
    for (flag, value) in
        [("--studio-connect", "https://user@plans.example"), ("--studio-planner", "plans.example:7601")]
    {
        let output = surefoot(&["serve", flag, value]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && said.contains(flag) && said.contains(value), "{said}");
    }
}

#[test]
fn a_reader_that_has_seen_enough_ends_the_program_quietly() {
    // Nobody reads what it prints once it has made the map.
    let mut child = Command::new(env!("CARGO_BIN_EXE_surefoot"))
        .args(["map", "show", "7"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command runs");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("the command ends");
    assert_eq!((output.status.code(), String::from_utf8_lossy(&output.stderr).as_ref()), (Some(141), ""));
}

#[test]
fn bad_input_ends_with_one_clear_line() {
    let cases: [(&[&str], &str); 8] = [
        (&["map", "show", "1", "--size", "20"], "size.width is 20"),
        (&["health", "http://127.0.0.1:1"], "cannot connect"),
        (&["serve", "--listen", "0.0.0.0:0"], "set --tls-cert and --tls-key, or --insecure"),
        (&["plan", "--listen", "0.0.0.0:0"], "set --tls-cert and --tls-key, or --insecure"),
        (&["up", "--listen", "127.0.0.1:0", "--planner-listen", "0.0.0.0:0"], "or --insecure"),
        (&["serve", "--tls-cert", "/no/cert.pem"], "--tls-cert and --tls-key must be given together"),
        (&["serve", "--tokens", "/no/tokens.toml"], "cannot read /no/tokens.toml"),
        (&["work", "--token-file", "/no/secret"], "cannot read /no/secret"),
    ];
    for (args, words) in cases {
        let output = surefoot(args);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{args:?} was accepted");
        assert!(message.contains(words), "{args:?} says `{message}`");
        assert_eq!(message.lines().count(), 1, "{args:?} says `{message}`");
    }
}

#[test]
fn a_map_is_described_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("map.png");
    let map = json(&surefoot(&["map", "show", "5", "--size", "60", "--json", "--png", picture.to_str().unwrap()]));
    assert_eq!(map["size"]["width"], 60);
    assert!(map["triangles"].as_u64().unwrap() > 1000);
    assert!(std::fs::read(&picture).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn a_scene_ends_with_arrivals_and_leaves_its_graphs_in_the_cache() {
    let cache = tempfile::tempdir().unwrap();
    let folder = cache.path().to_str().unwrap();
    let size = ["--maps", "1", "--npcs", "48", "--vertices", "60", "--neighbours", "6", "--repeats", "1"];
    let addresses = ["--listen", "127.0.0.1:0", "--planner-listen", "127.0.0.1:0", "--cache", folder];
    // With tokens, as in a deployment.
    let file = |name: &str, text: &str| {
        let path = cache.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let tokens = file("tokens.toml", "[[token]]\nname = \"qa\"\nrole = \"admin\"\nsecret = \"0123456789abcdef\"\n");
    let secret = file("secret", "0123456789abcdef\n");
    let protection = ["--tokens", &tokens, "--token-file", &secret];
    let summary =
        json(&surefoot(&[&["up", "--for", "25", "--json"], &size[..], &addresses[..], &protection[..]].concat()));
    assert!(summary["arrivals"].as_u64().unwrap() > 0, "{summary}");
    assert!(cache.path().join("graphs.redb").exists());
}

#[test]
fn a_scene_with_saved_worlds_can_be_started_again_and_again() {
    let folder = tempfile::tempdir().unwrap();
    let (cache, state) = (folder.path().join("cache"), folder.path().join("state"));
    let scene = ["up", "--for", "2", "--maps", "1", "--npcs", "2", "--vertices", "10", "--neighbours", "2"];
    let addresses = ["--listen", "127.0.0.1:0", "--planner-listen", "127.0.0.1:0"];
    let folders = ["--cache", cache.to_str().unwrap(), "--state", state.to_str().unwrap()];
    // There is room for the worlds of one scene only.
    let limit = ["--max-worlds-per-client", "1"];
    for start in 0..3 {
        let output = surefoot(&[&scene[..], &addresses[..], &folders[..], &limit[..]].concat());
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        // So few NPCs may not arrive anywhere in two seconds; anything else is a failure.
        assert!(output.status.success() || message.contains("no NPC arrived"), "start {start}: {message}");
        assert!(message.contains("2 NPCs on 1 map,"), "start {start}: {message}");
    }
}

#[cfg(unix)]
#[test]
fn a_server_ends_cleanly_on_sigterm() {
    let mut server = Command::new(env!("CARGO_BIN_EXE_surefoot"))
        .args(["serve", "--listen", "127.0.0.1:0"])
        .stderr(Stdio::piped())
        .spawn()
        .expect("the server starts");
    let mut log = std::io::BufReader::new(server.stderr.take().expect("piped"));
    let mut line = String::new();
    std::io::BufRead::read_line(&mut log, &mut line).expect("a log line");
    assert!(line.contains("world server ready"), "{line}");
    let killed = Command::new("kill").args(["-TERM", &server.id().to_string()]).status().expect("kill runs");
    assert!(killed.success());
    // Reads until the process closes its end of the pipe, so that it never blocks on a full one.
    std::io::Read::read_to_string(&mut log, &mut line).expect("the rest of the log");
    assert!(server.wait().expect("the server ends").success(), "{line}");
}

#[cfg(unix)]
#[test]
fn secrets_never_reach_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let tokens =
        file("tokens.toml", "[[token]]\nname = \"qa\"\nrole = \"worker\"\nsecret = \"hunter2-hunter2-hunter2\"");
    let secret = file("secret", "hunter2-hunter2-hunter2\n");
    let mut server = Command::new(env!("CARGO_BIN_EXE_surefoot"))
        .args(["serve", "--listen", "127.0.0.1:0", "--tokens", &tokens, "--log-format", "json"])
        .env("RUST_LOG", "trace")
        .stderr(Stdio::piped())
        .spawn()
        .expect("the server starts");
    let mut log = std::io::BufReader::new(server.stderr.take().expect("piped"));
    let mut server_log = String::new();
    let ready = loop {
        let mut line = String::new();
        std::io::BufRead::read_line(&mut log, &mut line).expect("a log line");
        server_log += &line;
        let event: serde_json::Value = serde_json::from_str(&line).expect("a JSON object a line");
        if event["message"] == "world server ready" {
            break event;
        }
    };
    let reading = std::thread::spawn(move || {
        std::io::Read::read_to_string(&mut log, &mut server_log).expect("the rest of the log");
        server_log
    });
    let uri = format!("http://{}", ready["address"].as_str().unwrap());
    let mut worker = Command::new(env!("CARGO_BIN_EXE_surefoot"))
        .args(["work", "--server", &uri, "--no-planner", "--token-file", &secret])
        .env("RUST_LOG", "trace")
        .stderr(Stdio::piped())
        .spawn()
        .expect("the worker starts");
    let mut log = std::io::BufReader::new(worker.stderr.take().expect("piped"));
    let mut worker_log = String::new();
    while !worker_log.contains("deciding for NPCs") {
        assert!(std::io::BufRead::read_line(&mut log, &mut worker_log).expect("a log line") > 0, "{worker_log}");
    }
    for process in [&worker, &server] {
        let killed = Command::new("kill").args(["-TERM", &process.id().to_string()]).status().expect("kill runs");
        assert!(killed.success());
    }
    std::io::Read::read_to_string(&mut log, &mut worker_log).expect("the rest of the log");
    assert!(worker.wait().unwrap().success() && server.wait().unwrap().success());
    let server_log = reading.join().unwrap();
    for (log, words) in [(&server_log, "\"caller\":\"qa\""), (&worker_log, "deciding for NPCs")] {
        assert!(log.contains(words), "no {words} in {log}");
        assert!(!log.contains("hunter2"), "a secret is in {log}");
    }
    let shown = Command::new(env!("CARGO_BIN_EXE_surefoot"))
        .args(["work", "--print-config"])
        .env("SUREFOOT_TOKEN", "hunter2-hunter2-hunter2")
        .output()
        .unwrap();
    let shown = String::from_utf8(shown.stdout).unwrap();
    assert!(shown.contains("# token = \"***\"") && !shown.contains("hunter2"), "{shown}");
    let help = Command::new(env!("CARGO_BIN_EXE_surefoot"))
        .args(["work", "--help"])
        .env("SUREFOOT_TOKEN", "hunter2-hunter2-hunter2")
        .output()
        .unwrap();
    assert!(!String::from_utf8_lossy(&help.stdout).contains("hunter2"));
}

#[test]
fn health_prints_the_agreed_document_and_its_exit_code_says_the_same() {
    let mut server = Command::new(env!("CARGO_BIN_EXE_surefoot"))
        .args(["serve", "--listen", "127.0.0.1:0", "--log-format", "json"])
        .env_remove("RUST_LOG")
        .stderr(Stdio::piped())
        .spawn()
        .expect("the server starts");
    let log = std::io::BufReader::new(server.stderr.take().expect("piped"));
    let address = std::io::BufRead::lines(log).find_map(|line| {
        let event: serde_json::Value = serde_json::from_str(&line.expect("a log line")).expect("a JSON object a line");
        event["address"].as_str().map(str::to_owned)
    });
    let uri = format!("http://{}", address.expect("an address"));
    let serving = serde_json::json!({ "uri": uri, "serving": true, "status": "SERVING", "error": null });
    assert_eq!(json(&surefoot(&["health", &uri, "--json"])), serving);
    server.kill().expect("it runs");
    server.wait().expect("it ends");
    let gone = surefoot(&["health", &uri, "--json"]);
    let document: serde_json::Value = serde_json::from_slice(&gone.stdout).expect("one JSON document on stdout");
    assert_eq!((&document["uri"], &document["serving"]), (&uri.as_str().into(), &false.into()));
    assert_eq!((gone.status.code(), &document["status"]), (Some(1), &"UNREACHABLE".into()));
    assert!(document["error"].as_str().unwrap().contains("cannot connect"), "{document}");
    assert!(String::from_utf8_lossy(&gone.stderr).starts_with("error: cannot connect"), "{gone:?}");
    let help = surefoot(&["health", "--help"]);
    let help = String::from_utf8_lossy(&help.stdout);
    for key in document.as_object().unwrap().keys() {
        assert!(help.contains(&format!("\"{key}\"")), "--help documents {key}: {help}");
    }
}

#[test]
fn the_statistics_of_a_map_are_the_agreed_document() {
    let report = json(&surefoot(&["map", "show", "7", "--size", "120", "--features", "all", "--stats", "--json"]));
    assert_eq!((&report["seed"], &report["size"]["height"]), (&7.into(), &80.into()));
    let share = |name: &str| report[name].as_f64().unwrap();
    assert!(share("walk_connected") < share("all_connected") && share("all_connected") <= 1.0);
    for means in ["drop", "jump", "double_jump", "pad", "zip_line", "teleporter", "jetpack"] {
        assert!(report["cut_off_without"][means].is_number(), "no {means}");
    }
    assert!(report["features"]["zip_lines"].is_number());
}

#[test]
fn a_map_goes_through_files_and_a_run_on_it_replays() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let run = |args: &[&str]| {
        let output = surefoot(args);
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let (saved, level, back, recording) = (path("a.sfmap"), path("a.glb"), path("b.sfmap"), path("run.sfreplay"));
    let hash = |source: &[&str]| json(&surefoot(&[&["map", "show"], source, &["--json"]].concat()))["hash"].clone();
    run(&["map", "generate", "9", "--size", "60", "--out", &saved]);
    assert_eq!(hash(&[&saved]), hash(&["9", "--size", "60"]));
    run(&["map", "export", &saved, "--out", &level]);
    run(&["map", "import", &level, "--out", &back]);
    let triangles = |file: &str| json(&surefoot(&["map", "show", file, "--json"]))["triangles"].clone();
    assert_eq!(triangles(&back), triangles(&saved));
    // A replay cannot generate an imported map, so its file must be given.
    run(&["map", "record", &back, "--npcs", "3", "--ticks", "700", "--out", &recording]);
    let refused = surefoot(&["map", "replay", &recording, "--check"]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--map"));
    assert!(run(&["map", "replay", &recording, "--check", "--map", &back]).contains("reached the same state"));
    run(&["map", "record", "9", "--size", "60", "--npcs", "3", "--ticks", "700", "--out", &recording]);
    assert!(run(&["map", "replay", &recording, "--check"]).contains("reached the same state"));
    for view in [&["--iso"][..], &["--top"], &["--section", "20"], &["--islands"]] {
        let picture = path("picture.png");
        run(&[&["map", "show", &saved, "--png", &picture], view].concat());
        let size = std::fs::metadata(&picture).unwrap().len();
        assert!(size > 5_000, "{view:?}: {size} bytes");
        std::fs::remove_file(picture).unwrap();
    }
}

#[test]
fn faulty_levels_and_files_are_refused_with_one_clear_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let out = folder.path().join("out.sfmap").to_str().unwrap().to_owned();
    let (empty, text, odd) = (file("empty.obj", b""), file("text.glb", b"not a level"), file("level.fbx", b""));
    let map = file("cut.sfmap", b"SFMAP");
    for (args, words) in [
        (vec!["map", "import", &empty, "--out", &out], "cannot import"),
        (vec!["map", "import", &text, "--out", &out], "cannot import"),
        (vec!["map", "import", &odd, "--out", &out], "is not a .glb, .gltf, .obj or .zip"),
        (vec!["map", "show", &map], "cannot use"),
        (vec!["map", "show", "nowhere"], "neither a seed nor a file"),
        (vec!["map", "replay", &map], "not a recording"),
        (vec!["map", "show", "1", "--features", "swamps"], "no feature `swamps`"),
        (vec!["map", "show", "1", "--section", "900", "--png", &out], "--section is 900"),
    ] {
        let output = surefoot(&args);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains(words), "{args:?}: {message}");
        assert!(!std::path::Path::new(&out).exists(), "{args:?} left a file");
    }
}
