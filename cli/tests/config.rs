//! Precedence of the sources of flag values, through the real command.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

fn surefoot(args: &[&str], variables: &[(&str, &str)]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_surefoot"));
    for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("SUREFOOT_")) {
        command.env_remove(name);
    }
    command.args(args).envs(variables.iter().copied()).output().expect("the command runs")
}

fn printed(args: &[&str], variables: &[(&str, &str)]) -> String {
    let output = surefoot(args, variables);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The value of a key as `--print-config` shows it.
fn shown<'a>(printed: &'a str, key: &str) -> &'a str {
    let line = printed.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = "));
    line.unwrap_or_else(|| panic!("no {key} in {printed}"))
}

fn write(folder: &Path, text: &str) -> String {
    let path = folder.join("surefoot.toml");
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn flags_win_over_variables_over_the_file_over_defaults() {
    let folder = tempfile::tempdir().unwrap();
    let file = write(
        folder.path(),
        "[common]\nmax_npcs = 10\nmax_envs = 5\n[serve]\nmax_npcs = 11\nmax_worlds = 12\nlisten = \"127.0.0.1:1\"\n\
         [work]\nno_planner = true\n",
    );
    let serve = ["serve", "--print-config", "--config", &file];
    let defaults = printed(&["serve", "--print-config"], &[]);
    assert_eq!(
        ["max_npcs", "max_worlds", "listen", "max_envs"].map(|key| shown(&defaults, key)),
        ["4096", "64", "\"127.0.0.1:7600\"", "16"]
    );
    let from_file = printed(&serve, &[]);
    assert_eq!(
        ["max_npcs", "max_worlds", "listen", "max_envs"].map(|key| shown(&from_file, key)),
        ["11", "12", "\"127.0.0.1:1\"", "5"]
    );
    let variables = [("SUREFOOT_MAX_WORLDS", "13"), ("SUREFOOT_MAX_NPCS", "13"), ("SUREFOOT_LISTEN", "127.0.0.1:2")];
    let all = printed(&[&serve[..], &["--max-npcs", "14"]].concat(), &variables);
    assert_eq!(
        ["max_npcs", "max_worlds", "listen", "max_envs"].map(|key| shown(&all, key)),
        ["14", "13", "\"127.0.0.1:2\"", "5"]
    );
    // A variable or a flag before the subcommand may give the file; a table applies to its subcommand only.
    assert_eq!(shown(&printed(&["serve", "--print-config"], &[("SUREFOOT_CONFIG", &file)]), "max_worlds"), "12");
    assert_eq!(shown(&printed(&["--config", &file, "up", "--print-config"], &[]), "max_npcs"), "10");
    // A switch that the file turns on can be turned off again.
    let work = ["work", "--print-config", "--config", &file];
    assert_eq!(shown(&printed(&work, &[]), "no_planner"), "true");
    assert_eq!(shown(&printed(&work, &[("SUREFOOT_NO_PLANNER", "false")]), "no_planner"), "false");
    assert_eq!(shown(&printed(&[&work[..], &["--no-planner=false"]].concat(), &[]), "no_planner"), "false");
}

#[test]
fn what_is_printed_can_be_fed_back() {
    let folder = tempfile::tempdir().unwrap();
    for (command, flags) in [
        ("serve", vec!["--max-npcs", "77", "--log-format", "json", "--idle-timeout", "7.5"]),
        ("plan", vec!["--cache", "/some/where", "--threads", "3"]),
        ("work", vec!["--name", "says \"hi\" \\ ", "--threshold", "0.25", "--no-planner"]),
        ("up", vec!["--for", "1.5", "--json", "--model", "12"]),
    ] {
        let printed_first = printed(&[&[command, "--print-config"], &flags[..]].concat(), &[]);
        let file = write(folder.path(), &printed_first);
        let again = printed(&[command, "--print-config", "--config", &file], &[]);
        assert_eq!(printed_first, again);
        let plain = printed(&[command, "--print-config"], &[]);
        assert_ne!(printed_first, plain, "{flags:?} change nothing");
    }
}

#[test]
fn every_flag_of_the_services_has_a_variable() {
    for command in ["serve", "plan", "work", "prove", "up"] {
        let help = printed(&[command, "--help"], &[]);
        let own = ["--help", "--version", "--print-config"];
        let mut variables = BTreeMap::new();
        let mut flag = String::new();
        // Joins each flag's paragraph into one line.
        for line in help.lines() {
            let text = line.trim_start();
            if let Some(name) = text
                .split([' ', '['])
                .find(|word| word.starts_with("--"))
                .filter(|_| line.starts_with("  ") && text.starts_with('-'))
            {
                flag = name.to_owned();
            }
            if !flag.is_empty() {
                *variables.entry(flag.clone()).or_insert(String::new()) += text;
            }
        }
        assert!(variables.len() > 5, "{help}");
        for (flag, text) in variables.iter().filter(|(flag, _)| !own.contains(&flag.as_str())) {
            let name = match flag.as_str() {
                // Agones sets it.
                "--agones-port" => "AGONES_SDK_GRPC_PORT".to_owned(),
                flag => format!("SUREFOOT_{}", flag[2..].replace('-', "_").to_uppercase()),
            };
            assert!(text.contains(&format!("[env: {name}")), "{command} {flag}: {text}");
        }
    }
}

#[test]
fn a_faulty_file_is_refused_with_what_and_where() {
    let folder = tempfile::tempdir().unwrap();
    for (text, words) in [
        ("[serve]\nmax_npc = 1", &["[serve] has no key `max_npc`", "known are", "max_npcs", "max_worlds"][..]),
        ("[server]\nmax_npcs = 1", &["no table [server]", "[common], [serve], [plan], [work], [prove], [up]"]),
        ("max_npcs = 1", &["no table [max_npcs]"]),
        ("serve = 1", &["`serve` must be a table"]),
        ("[common]\ncache_sizes = 1", &["[common] has no key `cache_sizes`", "cache_size"]),
        // Only `plan` has this flag, so it is not common.
        ("[common]\nmax_builds = 1", &["[common] has no key `max_builds`"]),
        ("[serve]\nmax_npcs = \"many\"", &["[serve] max_npcs", "'many'", "invalid digit"]),
        ("[work]\nnpcs = 0", &["[work] npcs", "1..=65536"]),
        ("[plan]\nthreads = [1, 2]", &["[plan] threads must be a string, a number, true or false"]),
        ("[up]\njson = 3", &["[up] json"]),
        ("[common]\nlog_format = \"xml\"", &["[common] log_format", "known are text, json"]),
        ("[serve]\nidle_timeout = 0", &["[serve] idle_timeout", "0.001 to 1000000 seconds"]),
        ("[serve]\nmax_npcs 1", &["is not TOML: line 2"]),
    ] {
        let file = write(folder.path(), text);
        let output = surefoot(&["serve", "--print-config", "--config", &file], &[]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "`{text}` was accepted");
        assert_eq!(message.lines().count(), 1, "{message}");
        for word in [&["surefoot.toml"], words].concat() {
            assert!(message.contains(word), "`{text}` says `{message}`, not `{word}`");
        }
    }
    let absent = surefoot(&["serve", "--config", "/does/not/exist"], &[]);
    assert!(String::from_utf8_lossy(&absent.stderr).contains("/does/not/exist"));
    assert!(!absent.status.success());
}

#[test]
fn other_commands_keep_their_own_config_flag() {
    let output = surefoot(&["train", "--config", "/does/not/exist.json", "/tmp/never"], &[]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && !message.contains("cannot read the configuration"), "{message}");
}
