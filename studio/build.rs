//! Builds the page with npm and writes a table of its files for the crate to embed. Without npm, or where the build fails,
//! the table is empty and says why: everything else of Surefoot does without the page.
//!
//! `SUREFOOT_STUDIO` decides: `require` fails the build without the page, `off` leaves it out, a folder is a page that was
//! built before, its path relative to the repository; unset: try, and warn. Cargo tries again when what the page is made of
//! or that variable has changed.

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What the page is made of, beside the contracts.
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
    let wish = std::env::var("SUREFOOT_STUDIO").unwrap_or_default();
    let built = match wish.as_str() {
        "off" => Err("it was left out (SUREFOOT_STUDIO=off)".to_owned()),
        "" | "require" => build(&page, &out.join("page")),
        folder => {
            let folder = page.join("../..").join(folder);
            println!("cargo:rerun-if-changed={}", folder.display());
            Ok(folder)
        }
    };
    let table = match built {
        Ok(folder) => table(&folder)?,
        Err(reason) if wish == "require" => return Err(format!("Studio cannot be built: {reason}").into()),
        Err(reason) => {
            if wish != "off" {
                println!("cargo:warning=built without Studio: {reason}; SUREFOOT_STUDIO=require tries again");
            }
            format!("const FILES: &[File] = &[];\nconst MISSING: &str = {reason:?};\n")
        }
    };
    std::fs::write(out.join("files.rs"), table)?;
    Ok(())
}

/// Builds the page into `dist`; otherwise says why that did not work.
fn build(page: &Path, dist: &Path) -> Result<PathBuf, String> {
    let npm = |arguments: &[&str]| -> Result<(), String> {
        let mut command = Command::new(if cfg!(windows) { "npm.cmd" } else { "npm" });
        let output = command.args(arguments).current_dir(page).output().map_err(|error| {
            if error.kind() == std::io::ErrorKind::NotFound {
                "npm is not installed".to_owned()
            } else {
                format!("npm does not run: {error}")
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
    // npm writes this file last.
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

/// Source text of a table of all files below `folder`.
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
        return Err(format!("{} holds no index.html", folder.display()).into());
    }
    text += "];\nconst MISSING: &str = \"\";\n";
    Ok(text)
}
