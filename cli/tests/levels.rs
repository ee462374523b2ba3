//! Levels on the command line: lists of maps, the flags that say how levels are read, and what an import reports.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use surefoot_cli::commands::map::{SeedOrFile, parse_maps};
use surefoot_levels::Files;
use surefoot_net::levels::folder::LevelFolder;

/// A square floor of that side in units of the level.
fn floor(side: u32) -> String {
    format!("o floor\nv 0 0 0\nv {side} 0 0\nv {side} 0 {side}\nv 0 0 {side}\nf 4 3 2 1\n")
}

/// A folder with `levels/hall.obj` and others, and the folder `work` beside it.
fn home() -> tempfile::TempDir {
    let home = tempfile::tempdir().unwrap();
    for folder in ["levels", "work"] {
        std::fs::create_dir(home.path().join(folder)).unwrap();
    }
    for (name, side) in [("hall.obj", 30), ("hall, first floor.obj", 40), ("centimetres.obj", 3000)] {
        std::fs::write(home.path().join("levels").join(name), floor(side)).unwrap();
    }
    home
}

/// Runs `surefoot` in the folder `work`.
fn run(home: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_surefoot"));
    command.args(args).current_dir(home.join("work")).output().expect("the command runs")
}

fn json(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON document on stdout")
}

fn refusal(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && said.lines().count() == 1, "{said}");
    said
}

#[test]
fn a_list_names_seeds_files_and_patterns() {
    let home = tempfile::tempdir().unwrap();
    std::fs::create_dir(home.path().join("sub")).unwrap();
    for name in ["a,b.glb", "hall, first floor.obj", "hall.obj", "yard.sfmap", "notes.txt"] {
        std::fs::write(home.path().join(name), "").unwrap();
    }
    let at = |name: &str| home.path().join(name).to_str().unwrap().to_owned();
    let file = |name: &str| SeedOrFile::File(home.path().join(name));
    let seed = SeedOrFile::Seed;
    let levels = ["a,b.glb", "hall, first floor.obj", "hall.obj", "yard.sfmap"].map(file).to_vec();
    for (list, expected) in [
        ("7, 0..3,9".to_owned(), [7, 0, 1, 2, 9].map(seed).to_vec()),
        (at("a,b.glb"), vec![file("a,b.glb")]),
        (at("notes.txt"), vec![file("notes.txt")]),
        (at("sub/../hall.obj"), vec![file("sub/../hall.obj")]),
        (
            format!("5,{},6,{}", at("a,b.glb"), at("hall.obj")),
            vec![seed(5), file("a,b.glb"), seed(6), file("hall.obj")],
        ),
        (format!("{}, {}", at("yard.sfmap"), at("hall.obj")), vec![file("yard.sfmap"), file("hall.obj")]),
        (at("*"), levels),
        (at("h?ll.obj"), vec![file("hall.obj")]),
        (format!("{},{}", at("hall.obj"), at("[h]*.obj")), vec![file("hall.obj"), file("hall, first floor.obj")]),
    ] {
        assert_eq!(parse_maps(&[&list]).expect(&list), expected, "{list}");
    }
    assert_eq!(parse_maps(&["3".to_owned(), at("hall.obj")]).unwrap(), [seed(3), file("hall.obj")]);
    let near = format!("there is {}", at("hall.obj"));
    for (list, words) in [
        ("nowhere".to_owned(), "`nowhere` is neither a seed, a range of seeds (0..8) nor a file"),
        (at("hal.obj"), near.as_str()),
        (format!("4,{}", at("hal.obj")), near.as_str()),
        (at("*.gltf"), "no level and no saved map matches"),
        (at("sub"), "is a folder"),
        ("4..4".to_owned(), "is not a range of 1 to 10000 seeds"),
        ("0..20000".to_owned(), "is not a range of 1 to 10000 seeds"),
    ] {
        let error = parse_maps(&[&list]).expect_err(&list).to_string();
        assert!(error.contains(words), "{list}: {error}");
    }
}

#[test]
fn a_map_is_a_seed_or_a_file_anywhere() {
    let home = home();
    let size = |map: &str| {
        let shown = json(&run(home.path(), &["map", "show", map, "--size", "60", "--json"]));
        (shown["seed"].as_u64(), shown["size"]["width"].as_u64().unwrap())
    };
    assert_eq!(size("../levels/hall.obj"), (None, 34));
    assert_eq!(size("../levels/hall, first floor.obj"), (None, 44));
    std::fs::write(home.path().join("work/7"), floor(30)).unwrap();
    assert_eq!(size("7"), (Some(7), 60));
    let said = refusal(&run(home.path(), &["map", "show", "../levels/hal.obj"]));
    assert!(said.contains("neither a seed nor a file; there is ../levels/hall.obj"), "{said}");
}

#[test]
fn flags_for_levels_are_applied_or_refused() {
    let home = home();
    let saved = home.path().join("work/hall.sfmap");
    let imported = run(home.path(), &["map", "import", "../levels/hall.obj", "--out", "hall.sfmap"]);
    assert!(imported.status.success() && saved.exists(), "{}", String::from_utf8_lossy(&imported.stderr));
    let shown = json(&run(home.path(), &["map", "show", "../levels/centimetres.obj", "--scale", "0.01", "--json"]));
    assert_eq!((&shown["size"]["width"], &shown["nodes"]["solid"]), (&34.into(), &1.into()));
    let upright = json(&run(home.path(), &["map", "show", "../levels/hall.obj", "--up", "z", "--json"]));
    assert!(upright["size"]["height"].as_u64().unwrap() > 40, "{upright}");
    let two = "../levels/hall.obj,../levels/hall, first floor.obj";
    for (args, words) in [
        (&["map", "show", "7", "--scale", "2"][..], "--scale is for levels, and 7 is the seed"),
        (&["map", "show", "hall.sfmap", "--up", "z"], "--up is for levels, and hall.sfmap is a saved map"),
        (
            &["graph", "build", "hall.sfmap", "--sidecar", "it.json"],
            "--sidecar is for levels, and hall.sfmap is a saved",
        ),
        (&["graph", "diff", "hall.sfmap", "7", "--no-names"], "--no-names is for levels"),
        (&["up", "--maps", two, "--sidecar", "it.json"], "--sidecar is for one level, and there are 2"),
        (&["up", "--maps", "3", "--all-scenes"], "--all-scenes is for levels"),
        (&["up", "--maps", "3,../levels/hall.obj"], "`3` is a seed: give only files"),
        (&["up", "--maps", "../levels/hal.obj"], "there is ../levels/hall.obj"),
    ] {
        let said = refusal(&run(home.path(), args));
        assert!(said.contains(words), "{args:?}: {said}");
    }
}

#[test]
fn a_graph_is_built_on_a_level_in_centimetres() {
    let home = home();
    let small = ["--vertices", "12", "--neighbours", "4", "--repeats", "1", "--threshold", "0.5", "--cache", "cache"];
    let build = ["graph", "build", "../levels/centimetres.obj", "--json"];
    assert!(refusal(&run(home.path(), &[&build[..], &small].concat())).contains("--scale"));
    let graph = json(&run(home.path(), &[&build[..], &small, &["--scale", "0.01"]].concat()));
    assert!(graph["vertices"].as_u64().unwrap() > 0, "{graph}");
    // The earlier version is a level of its own unit.
    std::fs::copy(home.path().join("levels/centimetres.obj"), home.path().join("work/earlier.obj")).unwrap();
    let changed = [&build[..], &small, &["--scale", "0.01", "--changed-from", "earlier.obj"]].concat();
    assert_eq!(json(&run(home.path(), &changed))["cached"], true);
}

#[test]
fn an_import_reports_what_became_of_each_node() {
    let home = home();
    let sky = "o sky\nv 0 10 0\nv 30 10 0\nv 30 10 30\nv 0 10 30\nf 8 7 6 5\n";
    std::fs::write(home.path().join("work/hall.obj"), floor(30) + sky).unwrap();
    std::fs::write(home.path().join("work/hall.surefoot.json"), r#"{"leave_out": ["sky"]}"#).unwrap();
    let output = run(home.path(), &["map", "import", "hall.obj", "--json", "--scale", "2"]);
    let report = json(&output);
    assert_eq!(report["map"]["size"][0], 64);
    assert_eq!((&report["frame"]["scale"], &report["frame"]["up"]), (&2.0.into(), &"y".into()));
    assert!(report["warnings"].is_array() && report["geometry"]["triangles"].as_u64() > Some(0), "{report}");
    let nodes = report["nodes"].as_array().unwrap();
    let text = |node: &serde_json::Value, key: &str| node[key].as_str().expect("a text").to_owned();
    let roles: Vec<[String; 2]> = nodes.iter().map(|node| ["name", "role"].map(|key| text(node, key))).collect();
    assert_eq!(roles, [["floor", "solid"], ["sky", "left_out"]]);
    assert!(nodes[1]["reason"].is_string() && nodes[1]["triangles"] == 2 && nodes[1]["bounds"].is_array(), "{report}");

    let output = run(home.path(), &["map", "import", "hall.obj", "--out", "hall.sfmap"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    for line in ["2 nodes: 1 solid, 1 left out", "sky", "the level's origin is at", "wrote hall.sfmap"] {
        assert!(text.contains(line), "no {line} in {text}");
    }
    let output = run(home.path(), &["map", "show", "hall.obj"]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("2 nodes: 1 solid, 1 left out"));
    // Where nothing else says so, a map is not thrown away.
    let output = run(home.path(), &["map", "import", "hall.obj"]);
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("--out"));
}

#[test]
fn a_level_reads_files_in_its_folder_and_no_others() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("level");
    std::fs::create_dir_all(folder.join("buffers")).unwrap();
    for (path, bytes) in [("secret.bin", "secret"), ("level/first floor.bin", "one"), ("level/buffers/two.bin", "two")]
    {
        std::fs::write(home.path().join(path), bytes).unwrap();
    }
    let files = LevelFolder::of(&folder.join("level.gltf"));
    for (path, bytes) in
        [("first floor.bin", "one"), ("./buffers/two.bin", "two"), ("buffers/../first floor.bin", "one")]
    {
        assert_eq!(files.read(path).as_deref(), Ok(bytes.as_bytes()), "{path}");
    }
    let absolute: PathBuf = home.path().join("secret.bin");
    let mut refused = vec![
        ("../secret.bin", "is outside the level's folder"),
        ("buffers/../../secret.bin", "is outside the level's folder"),
        (absolute.to_str().unwrap(), "is outside the level's folder"),
        ("buffers", "is not a file"),
        ("three.bin", "cannot read `three.bin`"),
        ("two\0.bin", "cannot read"),
    ];
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("../secret.bin", folder.join("link.bin")).unwrap();
        std::os::unix::fs::symlink(home.path(), folder.join("linked")).unwrap();
        refused.push(("link.bin", "is outside the level's folder"));
        refused.push(("linked/secret.bin", "is outside the level's folder"));
    }
    #[cfg(not(unix))]
    refused.push(("C:secret.bin", "outside"));
    for (path, words) in refused {
        let reason = files.read(path).expect_err(path);
        assert!(reason.contains(words), "{path}: {reason}");
    }
}
