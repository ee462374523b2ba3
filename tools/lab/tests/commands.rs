//! The commands of the laboratory as users run them: through `surefoot`, which hands them over.

use crate::surefoot;
use std::process::Output;

fn run(args: &[&str]) -> Output {
    surefoot().args(args).output().expect("the command runs")
}

fn json(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON document on stdout")
}

#[test]
fn help_of_the_laboratorys_commands_is_the_same_through_both_programs() {
    for command in ["train", "act", "eval", "challenge", "export", "import", "bench"] {
        let handed_over = run(&[command, "--help"]);
        let direct = std::process::Command::new(env!("CARGO_BIN_EXE_surefoot-lab")).args([command, "--help"]).output();
        let text = |output: &Output| String::from_utf8_lossy(&output.stdout).replace("surefoot-lab", "surefoot");
        let direct = direct.expect("the program runs");
        assert!(handed_over.status.success() && direct.status.success(), "{command}");
        assert_eq!(text(&handed_over), text(&direct));
        assert!(text(&direct).contains("Examples:"), "{command}");
    }
}

#[test]
fn bad_input_ends_with_one_clear_line() {
    let cases: [(&[&str], &str); 7] = [
        (&["eval", "--maps", "nowhere"], "--maps takes training, validation, test"),
        (&["eval", "--distance", "9..3"], "expected MIN..MAX"),
        (&["eval", "--goals", "0"], "--goals is 0"),
        (&["eval", "--model", "/does/not/exist"], "/does/not/exist/manifest.json"),
        (&["eval", "--vertices", "1"], "settings.vertices is 1"),
        (&["work", "--inference", "burn", "--token-file", "/no/secret"], "cannot read /no/secret"),
        // Before anything is measured, with and without the feature `fleet`.
        (&["bench", "scale", "--store", "nowhere", "--blobs", "file:///no"], "--store"),
    ];
    for (args, words) in cases {
        let output = run(args);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{args:?} was accepted");
        assert!(message.contains(words), "{args:?} says `{message}`");
        assert_eq!(message.lines().count(), 1, "{args:?} says `{message}`");
    }
}

#[test]
fn eval_prints_the_agreed_document() {
    let report = json(&run(&[
        "eval",
        "--maps",
        "1000",
        "--size",
        "100",
        "--goals",
        "12",
        "--vertices",
        "30",
        "--neighbours",
        "6",
        "--repeats",
        "1",
        "--json",
    ]));
    assert_eq!(report["method"], "spaced");
    assert_eq!(report["maps"], serde_json::json!([1000]));
    for difficulty in ["all", "easy", "medium", "hard"] {
        let rate = &report["success"][difficulty];
        assert!(rate["low"].as_f64() <= rate["rate"].as_f64() && rate["rate"].as_f64() <= rate["high"].as_f64());
    }
    assert_eq!(report["success"]["all"]["n"], 12);
    let ends = report["ends"].as_object().unwrap();
    assert_eq!(ends.values().map(|count| count.as_u64().unwrap()).sum::<u64>(), 12);
    for figure in ["vertices", "edges", "islands", "build_s", "probes", "search_us_median"] {
        assert!(report["graph"][figure].is_number(), "no {figure}");
    }
}

#[test]
fn levels_and_bodies_of_files_are_taken_by_eval_graph_train_and_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let outcome = |args: &[&str]| {
        let output = run(args);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.success(), said)
    };
    let (saved, level, body, run_folder) = (path("a.sfmap"), path("a.glb"), path("goblin.toml"), path("run"));
    std::fs::write(&body, "height = 1.25\nradius = 0.25\nforward_speed = 4.0\n").unwrap();
    assert_eq!(outcome(&["map", "generate", "9", "--size", "60", "--out", &saved]), (true, String::new()));
    assert!(outcome(&["map", "export", &saved, "--out", &level]).0);

    let small = ["--vertices", "20", "--neighbours", "6", "--repeats", "1"];
    let eval = ["eval", "--maps", &level, "--body", &body, "--goals", "6", "--json"];
    let report = json(&run(&[&eval[..], &small].concat()));
    assert_eq!((&report["per_map"][0]["map"], &report["success"]["all"]["n"]), (&"a.glb".into(), &6.into()));

    // Nothing is learned: the run is set up and written.
    let train = ["train", &run_folder, "--maps", &level, "--body", &body, "--updates", "0"];
    let (trained, said) = outcome(&train);
    assert!(trained, "{said}");
    let config = std::fs::read(folder.path().join("run/config.json")).unwrap();
    let config: serde_json::Value = serde_json::from_slice(&config).unwrap();
    assert_eq!(config["collector"]["body"]["height"], 1.25);
    assert_eq!(config["collector"]["world_count"], 1, "a single map is trained on alone");
    let copied = config["collector"]["levels"][0].as_str().unwrap();
    assert!(copied.ends_with("run/levels/0-a.sfmap") && std::path::Path::new(copied).exists(), "{copied}");
    assert!(outcome(&["train", &run_folder, "--resume"]).0);

    let scene = ["up", "--for", "3", "--maps", &level, "--body", "unity", "--npcs", "4", "--cache", &path("cache")];
    let addresses = ["--listen", "127.0.0.1:0", "--planner-listen", "127.0.0.1:0"];
    let (ended, said) = outcome(&[&scene[..], &addresses, &small].concat());
    // So few NPCs may not arrive anywhere in three seconds; anything else is a failure.
    assert!((ended || said.contains("no NPC arrived")) && said.contains("4 NPCs on 1 map,"), "{said}");

    let (wide, wrong) = (path("wide.toml"), path("wrong.toml"));
    std::fs::write(&wide, "radius = 9.0\n").unwrap();
    std::fs::write(&wrong, "wings = 2\n").unwrap();
    for (file, words) in
        [(&wide, "body.radius is 9, but must be 0.15 to 1"), (&wrong, "wings"), (&level, "there is no body")]
    {
        for command in
            [&["eval", "--body", file][..], &["up", "--body", file], &["train", &path("other"), "--body", file]]
        {
            let (done, said) = outcome(command);
            assert!(!done && said.contains(words), "{command:?}: {said}");
        }
    }
}

#[test]
fn levels_need_no_conversion_and_lie_anywhere() {
    let home = tempfile::tempdir().unwrap();
    for folder in ["levels", "work"] {
        std::fs::create_dir(home.path().join(folder)).unwrap();
    }
    // Square floors, in centimetres and in metres.
    for (name, side) in [("hall.obj", 3000), ("hall, first floor.obj", 4000), ("yard.obj", 30)] {
        let floor = format!("v 0 0 0\nv {side} 0 0\nv {side} 0 {side}\nv 0 0 {side}\nf 4 3 2 1\n");
        std::fs::write(home.path().join("levels").join(name), floor).unwrap();
    }
    let run = |args: &[&str]| surefoot().args(args).current_dir(home.path().join("work")).output().unwrap();
    let maps = |args: &[&str]| {
        let quick = ["eval", "--method", "policy", "--goals", "4", "--json"];
        json(&run(&[&quick, args].concat()))["maps"].clone()
    };
    let both = "../levels/hall.obj,../levels/hall, first floor.obj";
    assert_eq!(maps(&["--maps", both, "--scale", "0.01"]), serde_json::json!(["hall.obj", "hall, first floor.obj"]));
    let mixed = ["--size", "60", "--maps", "1000", "../levels/y*.obj"];
    assert_eq!(maps(&mixed), serde_json::json!([1000, "yard.obj"]));
    let refused: [(&[&str], &str); 5] = [
        (&["eval", "--maps", "1000", "--scale", "0.01"], "--scale is for levels, and 1000 is the seed"),
        (&["eval", "--maps", both, "--sidecar", "it.json"], "--sidecar is for one level, and there are 2"),
        (&["eval", "--maps", "../levels/hal.obj"], "there is ../levels/hall.obj"),
        (&["train", "run", "--maps", "3,../levels/yard.obj"], "yard.obj` is a file: give only seeds"),
        (&["act", "--learner", "http://127.0.0.1:1", "--maps", "3"], "`3` is a seed: give only files"),
    ];
    for (args, words) in refused {
        let output = run(args);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && said.contains(words), "{args:?}: {said}");
    }
}

#[test]
fn exported_models_are_imported_unchanged() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (onnx, safetensors, model) = (path("policy.onnx"), path("policy.safetensors"), path("model"));
    let exported = run(&["export", "--onnx", &onnx, "--safetensors", &safetensors]);
    assert!(exported.status.success(), "{}", String::from_utf8_lossy(&exported.stderr));
    assert!(std::fs::metadata(&onnx).unwrap().len() > 100_000);
    assert!(run(&["import", &safetensors, &model, "--name", "back"]).status.success());
    let check = |args: &[&str]| json(&run(&[&["export", "--check", "20", "--json"], args].concat()));
    assert_eq!(check(&[])["steps"], check(&["--model", &model])["steps"]);

    std::fs::write(&safetensors, b"not weights").unwrap();
    let refused = run(&["import", &safetensors, &model]);
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && message.contains("policy.safetensors"), "{message}");
    assert!(!run(&["export"]).status.success());
}

#[test]
fn the_suite_writes_table_plots_and_json() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let models = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models");
    let args = ["eval", "--suite", "paper", "--size", "60", "--goals", "6", "--models", models, "--out", out];
    let output = run(&args);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let table = String::from_utf8(output.stdout).unwrap();
    assert!(table.contains("general reactive") && table.contains("(68.0)"), "{table}");
    assert_eq!(std::fs::read_to_string(folder.path().join("table.md")).unwrap(), table);
    for plot in ["success-by-distance.svg", "generalisation.svg"] {
        let text = std::fs::read_to_string(folder.path().join(plot)).unwrap();
        assert!(text.starts_with("<svg") && text.contains("general reactive"), "{plot}");
    }
    let report: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.path().join("results.json")).unwrap()).unwrap();
    assert_eq!(report["goals"], 6);
}
