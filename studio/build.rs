//! Builds the page with npm and writes a table of its files for the crate to embed. If npm is missing or fails, the
//! table is empty and gives the reason: the rest of Surefoot works without the page.
//!
//! The environment variable `SUREFOOT_STUDIO` selects what happens. `require`: the build fails without the page. `off`:
//! the page is left out. A folder, relative to the repository: the page was already built there. Unset: the page is
//! built if possible, otherwise Cargo prints a warning. Cargo runs this script again when the sources of the page or
//! the variable change.

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Sources of the page, apart from the contracts.
const SOURCES: [&str; 7] =
    ["src", "index.html", "package.json", "package-lock.json", "tsconfig.json", "vite.config.ts", "buf.gen.yaml"];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-env-changed=SUREFOOT_STUDIO");
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=../proto/surefoot");
    let page = Path::new(&std::env::var("CARGO_MANIFEST_DIR")?).join("page");
    for source in SOURCES {
        println!("cargo:rerun-if-changed={}", page.join(source).display());
    }
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    let mode = std::env::var("SUREFOOT_STUDIO").unwrap_or_default();
    let built = match mode.as_str() {
        "off" => Err("it was disabled (SUREFOOT_STUDIO=off)".to_owned()),
        "" | "require" => build(&page, &out.join("page")),
        folder => {
            let folder = page.join("../..").join(folder);
            println!("cargo:rerun-if-changed={}", folder.display());
            Ok(folder)
        }
    };
    let table = match built {
        Ok(folder) => table(&folder)?,
        Err(reason) if mode == "require" => return Err(format!("Studio cannot be built: {reason}").into()),
        Err(reason) => {
            if mode != "off" {
                println!("cargo:warning=built without Studio: {reason}; set SUREFOOT_STUDIO=require to try again");
            }
            format!("const FILES: &[File] = &[];\nconst MISSING: &str = {reason:?};\n")
        }
    };
    std::fs::write(out.join("files.rs"), table)?;
    Ok(())
}

/// Builds the page into `dist` and returns that folder.
///
/// # Errors
/// Returns the reason if npm is missing or fails.
fn build(page: &Path, dist: &Path) -> Result<PathBuf, String> {
    let npm = |arguments: &[&str]| -> Result<(), String> {
        let mut command = Command::new(if cfg!(windows) { "npm.cmd" } else { "npm" });
        let output = command.args(arguments).current_dir(page).output().map_err(|error| {
            if error.kind() == std::io::ErrorKind::NotFound {
                "npm is not installed".to_owned()
            } else {
                format!("npm cannot be started: {error}")
            }
        })?;
        if output.status.success() {
            return Ok(());
        }
        let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
        let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
        let last = lines[lines.len().saturating_sub(6)..].join(" | ");
        Err(format!("`npm {}` failed: {last}", arguments.join(" ")))
    };
    // npm writes this file at the end of an installation.
    let installed = modified(&page.join("node_modules/.package-lock.json"));
    if installed.is_none() || installed < modified(&page.join("package-lock.json")) {
        npm(&["ci", "--no-audit", "--no-fund"])?;
    }
    let dist_argument = dist.to_str().ok_or("the path of the build folder is not Unicode")?;
    npm(&["run", "build", "--", "--outDir", dist_argument, "--emptyOutDir"])?;
    Ok(dist.to_owned())
}

fn modified(path: &Path) -> Option<std::time::SystemTime> {
    path.metadata().and_then(|metadata| metadata.modified()).ok()
}

/// Returns the source text of a table of all files below `folder`.
fn table(folder: &Path) -> Result<String, Box<dyn Error>> {
    let folder = folder.canonicalize().map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut paths = Vec::new();
    let mut folders = vec![folder.clone()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next)? {
            let path = entry?.path();
            if path.is_dir() { folders.push(path) } else { paths.push(path) }
        }
    }
    paths.sort();
    let mut text = String::from("const FILES: &[File] = &[\n");
    for path in &paths {
        let name = path.strip_prefix(&folder)?.to_str().ok_or("a file's name is not Unicode")?.replace('\\', "/");
        writeln!(text, "    File {{ path: {name:?}, content: include_bytes!({path:?}) }},")?;
    }
    if !paths.iter().any(|path| path.ends_with("index.html")) {
        return Err(format!("{} has no index.html", folder.display()).into());
    }
    text += "];\nconst MISSING: &str = \"\";\n";
    Ok(text)
}
