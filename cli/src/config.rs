//! Sources of flag values, each overriding the one before: defaults, one TOML file, the environment, the command line.
//!
//! For `serve`, `plan`, `work`, `prove` and `up`, a value in the file becomes the flag's default and every flag gets a
//! variable before clap parses. So clap itself applies the precedence, checks types, and shows the effective values in
//! `--help`. This module does not know what the flags mean.

use anyhow::{Context, anyhow, bail};
use clap::builder::PossibleValue;
use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Subcommands that read the file, each from the table of its name.
const CONFIGURED: [&str; 5] = ["serve", "plan", "work", "prove", "up"];
/// Name of the table with keys that several subcommands share.
const COMMON: &str = "common";
/// The environment variable with the path of the file.
const FILE_VARIABLE: &str = "SUREFOOT_CONFIG";
/// Flags whose values are never shown.
const SECRETS: [&str; 3] = ["token", "store", "nats"];

/// Parses the command line, the environment and the file; `None` if `--print-config` was given and handled.
///
/// Like clap's own parsers, this exits the process on `--help` and on invalid flags.
pub fn read(command: Command) -> anyhow::Result<Option<ArgMatches>> {
    let mut args: Vec<OsString> = std::env::args_os().collect();
    let mut command = with_examples_first(with_own_flags(command));
    if let Some(path) = find_file(&command, &args) {
        let file = ConfigFile::read(&path)?;
        file.check(&command)?;
        command = file.apply_to(command);
    }
    let mut matches = command.clone().get_matches_from(&args);
    if matches.subcommand().is_none() {
        // Without a subcommand: `up` with its defaults.
        args.push("up".into());
        matches = command.clone().get_matches_from(&args);
    }
    let is_printed = matches.subcommand().is_some_and(|(name, values)| {
        let asked = CONFIGURED.contains(&name) && values.get_flag("print_config");
        if asked {
            print!("{}", render(&command, name, values));
        }
        asked
    });
    Ok((!is_printed).then_some(matches))
}

/// Shows the examples of each command after its task, before its flags.
fn with_examples_first(command: Command) -> Command {
    let template = "{about-with-newline}{after-help}\n\n{usage-heading} {usage}\n\n{all-args}";
    command.help_template(template).mut_subcommands(with_examples_first)
}

/// Those of the subcommands above that this program has.
fn configured(command: &Command) -> Vec<&'static str> {
    CONFIGURED.into_iter().filter(|name| command.find_subcommand(name).is_some()).collect()
}

/// Gives flags their variables, and adds the flags for configuration itself.
fn with_own_flags(command: Command) -> Command {
    let file = || {
        Arg::new("config_file")
            .long("config")
            .value_name("FILE")
            .env(FILE_VARIABLE)
            .help_heading("Configuration")
            .value_parser(value_parser!(PathBuf))
            .help("TOML file with values of flags; variables and flags override it")
    };
    let print = Arg::new("print_config")
        .long("print-config")
        .action(ArgAction::SetTrue)
        .help_heading("Configuration")
        .help("Print the effective values as a file for --config, and exit");
    let mut command = command.mut_args(with_variable).arg(file());
    for name in configured(&command) {
        command = command.mut_subcommand(name, |sub| sub.mut_args(with_variable).arg(file()).arg(print.clone()));
    }
    command
}

/// Gives a flag its variable, and lets a switch be turned off (`--json=false`) when the file turns it on.
fn with_variable(arg: Arg) -> Arg {
    let Some(long) = arg.get_long() else { return arg };
    let variable = format!("SUREFOOT_{}", key(long).to_uppercase());
    let is_secret = SECRETS.contains(&long);
    let arg = if arg.get_env().is_some() { arg } else { arg.env(variable) };
    let arg = arg.hide_env_values(is_secret).hide_default_value(is_secret);
    if !matches!(arg.get_action(), ArgAction::SetTrue) {
        return arg;
    }
    arg.action(ArgAction::Set)
        .num_args(0..=1)
        .require_equals(true)
        .default_missing_value("true")
        .default_value("false")
        .hide_default_value(true)
        .hide_possible_values(true)
        .value_name("true|false")
        .value_parser(value_parser!(bool))
}

/// The key of a flag in a file.
fn key(long: &str) -> String {
    long.replace('-', "_")
}

/// Flags of a command that a file can set, with their keys.
fn flags(command: &Command) -> impl Iterator<Item = (String, &Arg)> {
    let own = ["config_file", "print_config"];
    let flags = command.get_arguments().filter(move |arg| !own.contains(&arg.get_id().as_str()));
    flags.filter_map(|arg| Some((key(arg.get_long()?), arg)))
}

fn subcommand<'a>(command: &'a Command, name: &str) -> &'a Command {
    command.find_subcommand(name).expect("a configured subcommand exists")
}

/// The file given on the command line or by the variable. Other subcommands may have a different `--config`.
fn find_file(command: &Command, args: &[OsString]) -> Option<PathBuf> {
    let mut args = args.iter().skip(1).filter_map(|arg| arg.to_str());
    let mut is_configured = false;
    while let Some(arg) = args.next() {
        match arg.strip_prefix("--config") {
            Some("") => return args.next().map(PathBuf::from),
            Some(value) if value.starts_with('=') => return Some(PathBuf::from(&value[1..])),
            _ if CONFIGURED.contains(&arg) => is_configured = true,
            _ if !is_configured && command.find_subcommand(arg).is_some() => break,
            _ => {}
        }
    }
    std::env::var_os(FILE_VARIABLE).map(PathBuf::from)
}

/// A TOML file with values of flags.
struct ConfigFile<'a> {
    path: &'a Path,
    tables: Table,
}

impl<'a> ConfigFile<'a> {
    fn read(path: &'a Path) -> anyhow::Result<Self> {
        let shown = path.display();
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read the configuration {shown}"))?;
        let tables = text.parse::<Table>().map_err(|error| {
            let line = error.span().map_or(1, |span| text[..span.start.min(text.len())].lines().count().max(1));
            anyhow!("{shown} is not TOML: line {line}: {}", error.message())
        })?;
        Ok(Self { path, tables })
    }

    /// Rejects unknown tables and keys, and values that their flags do not accept.
    ///
    /// `surefoot-lab` has only some of the commands, so it leaves the check to `surefoot`.
    fn check(&self, command: &Command) -> anyhow::Result<()> {
        if configured(command).len() < CONFIGURED.len() {
            return Ok(());
        }
        let file = self.path.display();
        for (table, values) in &self.tables {
            if table != COMMON && !CONFIGURED.contains(&table.as_str()) {
                bail!("{file}: there is no table [{table}]; known are [common], [{}]", CONFIGURED.join("], ["));
            }
            let Value::Table(values) = values else { bail!("{file}: `{table}` must be a table: [{table}]") };
            let known =
                if table == COMMON { common_flags(command) } else { flags(subcommand(command, table)).collect() };
            for (name, value) in values {
                let Some((_, arg)) = known.iter().find(|(key, _)| key == name) else {
                    let mut known: Vec<&str> = known.iter().map(|(key, _)| key.as_str()).collect();
                    known.sort_unstable();
                    bail!("{file}: [{table}] has no key `{name}`; known are {}", known.join(", "));
                };
                let value = plain(value)
                    .with_context(|| format!("{file}: [{table}] {name} must be a string, a number, true or false"))?;
                check_value(arg, &value).map_err(|reason| anyhow!("{file}: [{table}] {name}: {reason}"))?;
            }
        }
        Ok(())
    }

    /// Makes the values of a checked file the defaults of their flags.
    fn apply_to(&self, command: Command) -> Command {
        let mut command = command.mut_args(|arg| self.with_default(arg, &[COMMON]));
        for name in configured(&command) {
            command = command.mut_subcommand(name, |sub| sub.mut_args(|arg| self.with_default(arg, &[name, COMMON])));
        }
        command
    }

    /// Sets the flag's default from the first of these tables that has its key.
    fn with_default(&self, arg: Arg, tables: &[&str]) -> Arg {
        let Some(key) = arg.get_long().map(key) else { return arg };
        let found = tables.iter().find_map(|&table| self.tables.get(table)?.as_table()?.get(&key));
        match found.and_then(plain) {
            Some(value) => arg.default_value(value),
            None => arg,
        }
    }
}

/// Flags of the program itself, and flags that several configured subcommands have.
fn common_flags(command: &Command) -> Vec<(String, &Arg)> {
    let mut common: Vec<(String, &Arg)> = flags(command).collect();
    let mut seen = Vec::new();
    for (key, arg) in CONFIGURED.iter().flat_map(|name| flags(subcommand(command, name))) {
        if seen.contains(&key) && !common.iter().any(|(known, _)| *known == key) {
            common.push((key.clone(), arg));
        }
        seen.push(key);
    }
    common
}

/// A value as it would be written on the command line; `None` for dates, arrays and tables.
fn plain(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Integer(number) => Some(number.to_string()),
        Value::Float(number) => Some(number.to_string()),
        Value::Boolean(answer) => Some(answer.to_string()),
        Value::Datetime(_) | Value::Array(_) | Value::Table(_) => None,
    }
}

/// Checks a value with the flag's own parser.
fn check_value(arg: &Arg, value: &str) -> Result<(), String> {
    let long = arg.get_long().expect("only flags are configured");
    let lone = Command::new("check").no_binary_name(true).disable_help_flag(true).arg(arg.clone().required(false));
    let Err(error) = lone.try_get_matches_from([format!("--{long}={value}")]) else { return Ok(()) };
    if SECRETS.contains(&long) {
        return Err("is not valid".to_owned());
    }
    let possible: Vec<PossibleValue> = arg.get_possible_values();
    let names: Vec<&str> = possible.iter().map(PossibleValue::get_name).collect();
    let reason = error.to_string().lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned();
    Err(if names.is_empty() { reason } else { format!("{reason}; known are {}", names.join(", ")) })
}

/// The effective values of a subcommand, as a file.
fn render(command: &Command, name: &str, values: &ArgMatches) -> String {
    let table = |name: &str, command: &Command| {
        let lines = flags(command).map(|(key, arg)| line(&key, arg, values));
        format!("[{name}]\n{}", lines.collect::<String>())
    };
    format!("{}\n{}", table(COMMON, command), table(name, subcommand(command, name)))
}

fn line(key: &str, arg: &Arg, values: &ArgMatches) -> String {
    let given = values.get_raw(arg.get_id().as_str()).into_iter().flatten();
    let given: Vec<_> = given.map(|value| value.to_string_lossy()).collect();
    // Flags that take several values split one at its commas.
    match (!given.is_empty()).then(|| given.join(",")) {
        None => format!("# {key} is not set\n"),
        Some(_) if SECRETS.contains(&key) => format!("# {key} = \"***\"\n"),
        Some(value) => format!("{key} = {}\n", literal(&value)),
    }
}

/// A value in TOML: a number or a boolean if the text is exactly one, otherwise a string.
fn literal(text: &str) -> Value {
    let number = text.parse::<i64>().ok().filter(|number| number.to_string() == text).map(Value::Integer);
    let float = || text.parse::<f64>().ok().filter(|float| float.to_string() == text && text.contains('.'));
    let answer = || text.parse::<bool>().ok().map(Value::Boolean);
    number.or_else(|| float().map(Value::Float)).or_else(answer).unwrap_or_else(|| Value::String(text.to_owned()))
}
