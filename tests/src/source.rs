//! The workspace's source as data: the imports between files and the names that a file mentions.
//!
//! Parses only `mod`, `use` and paths that begin with `crate`, `super` or `self`; skips the rest of the language.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Root folder of the workspace.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// One crate's files by module path: `["map", "generate"]` is `src/map/generate.rs`.
pub struct Crate {
    files: BTreeMap<Vec<String>, File>,
}

struct File {
    path: String,
    code: String,
    uses: Vec<Use>,
}

struct Use {
    path: Vec<String>,
    is_public: bool,
}

impl Crate {
    /// Reads all files of a crate, such as `core/world`.
    pub fn read(name: &str) -> Self {
        let source = root().join(name).join("src");
        let mut files = BTreeMap::new();
        let mut open = vec![source.clone()];
        while let Some(folder) = open.pop() {
            for entry in std::fs::read_dir(&folder).expect("a source folder") {
                let path = entry.expect("an entry").path();
                if path.is_dir() {
                    open.push(path);
                } else if path.extension().is_some_and(|extension| extension == "rs") {
                    let relative = path.strip_prefix(&source).expect("below the folder").to_owned();
                    let code = without_comments(&std::fs::read_to_string(&path).expect("a source file"));
                    let uses = uses_in(&code);
                    let path = format!("{name}/src/{}", relative.display());
                    files.insert(module_of(&relative), File { path, code, uses });
                }
            }
        }
        Self { files }
    }

    /// Path and code of each file, without comments.
    pub fn files(&self) -> impl Iterator<Item = (&str, &str)> {
        self.files.values().map(|file| (file.path.as_str(), file.code.as_str()))
    }

    /// Groups of files that import each other circularly.
    pub fn circles(&self) -> Vec<Vec<&str>> {
        let edges: BTreeMap<&Vec<String>, BTreeSet<&Vec<String>>> =
            self.files.iter().map(|(module, file)| (module, self.imports(module, file))).collect();
        let reachable = |from: &Vec<String>| {
            let mut seen: BTreeSet<&Vec<String>> = BTreeSet::new();
            let mut open: Vec<&Vec<String>> = edges[from].iter().copied().collect();
            while let Some(module) = open.pop() {
                if seen.insert(module) {
                    open.extend(&edges[module]);
                }
            }
            seen
        };
        let reached: BTreeMap<&Vec<String>, BTreeSet<&Vec<String>>> =
            edges.keys().map(|&module| (module, reachable(module))).collect();
        let mut groups: BTreeSet<Vec<&str>> = BTreeSet::new();
        for (module, others) in &reached {
            if others.contains(*module) {
                let group = others.iter().filter(|other| reached[**other].contains(*module));
                groups.insert(group.map(|other| self.files[*other].path.as_str()).collect());
            }
        }
        groups.into_iter().collect()
    }

    /// Module paths of the files that a file imports from.
    fn imports(&self, module: &[String], file: &File) -> BTreeSet<&Vec<String>> {
        let is_facade = |file: &File| file.path.ends_with("/mod.rs") || file.path.ends_with("/lib.rs");
        // Re-exports of a `mod.rs` or `lib.rs` do not count as imports.
        let uses = file.uses.iter().filter(|found| !(found.is_public && is_facade(file)));
        let targets = uses.filter_map(|found| self.defining_file(module, &found.path, 0));
        targets.filter(|target| target.as_slice() != module).collect()
    }

    /// The file that defines the item at `path`, resolved from `module`.
    fn defining_file(&self, module: &[String], path: &[String], depth: usize) -> Option<&Vec<String>> {
        assert!(depth < 32, "a circular path: {path:?}");
        let mut at: Vec<String> = module.to_vec();
        let mut rest = path;
        match path.first()?.as_str() {
            "crate" => (at, rest) = (Vec::new(), &path[1..]),
            "self" => rest = &path[1..],
            "super" => {
                while rest.first().is_some_and(|segment| segment == "super") {
                    at.pop()?;
                    rest = &rest[1..];
                }
            }
            first => {
                // A child module, or another crate.
                let child = [at.as_slice(), &[first.to_owned()]].concat();
                self.files.get(&child)?;
            }
        }
        while let Some(segment) = rest.first() {
            let child = [at.as_slice(), std::slice::from_ref(segment)].concat();
            if self.files.contains_key(&child) {
                (at, rest) = (child, &rest[1..]);
                continue;
            }
            let handed_on = self.files.get(&at)?.uses.iter().find(|found| {
                found.is_public && found.path.last() == Some(segment) && found.path.first() != Some(&"crate".to_owned())
            });
            if let Some(found) = handed_on {
                return self.defining_file(&at.clone(), &found.path, depth + 1);
            }
            break;
        }
        self.files.get_key_value(&at).map(|(module, _)| module)
    }
}

fn module_of(relative: &Path) -> Vec<String> {
    let mut parts: Vec<String> =
        relative.with_extension("").iter().map(|part| part.to_string_lossy().into_owned()).collect();
    if parts.last().is_some_and(|last| ["mod", "lib", "main"].contains(&last.as_str())) {
        parts.pop();
    }
    parts
}

/// The code without comments; line numbers stay the same.
fn without_comments(text: &str) -> String {
    text.lines().map(|line| line.find("//").map_or(line, |at| &line[..at])).collect::<Vec<_>>().join("\n")
}

/// All `use` declarations, one path for each name.
fn uses_in(code: &str) -> Vec<Use> {
    let mut uses = Vec::new();
    let code = code.find("#[cfg(test)]").map_or(code, |at| &code[..at]);
    let starts = ["use ", "pub use ", "pub(crate) use ", "pub(super) use "];
    for statement in code.split(';') {
        let mut at = 0;
        let mut begin = None;
        for line in statement.split_inclusive('\n') {
            if let Some(start) = starts.iter().find(|start| line.trim_start().starts_with(**start)) {
                begin = Some((at + line.len() - line.trim_start().len() + start.len(), start.len() > 4));
            }
            at += line.len();
        }
        let Some((begin, is_public)) = begin else { continue };
        let tree: String = statement[begin..].split_whitespace().collect::<Vec<_>>().join(" ");
        // Lines of text that happen to begin with the word are no declarations.
        if tree.chars().all(|letter| letter.is_alphanumeric() || "_:{}, *".contains(letter)) {
            expand(&tree, &[], &mut |path| uses.push(Use { path, is_public }));
        }
    }
    uses
}

/// Expands a `use` tree into one path for each name.
fn expand(tree: &str, prefix: &[String], found: &mut dyn FnMut(Vec<String>)) {
    let tree = tree.trim();
    let Some(open) = tree.find('{') else {
        let name = tree.split(" as ").next().unwrap_or_default();
        let mut path = prefix.to_vec();
        path.extend(name.split("::").map(|segment| segment.trim().to_owned()).filter(|segment| !segment.is_empty()));
        if path.len() > 1 && path.last().is_some_and(|last| last == "self") {
            path.pop();
        }
        if !path.is_empty() {
            found(path);
        }
        return;
    };
    let mut prefix = prefix.to_vec();
    let before = tree[..open].trim_end_matches("::");
    prefix.extend(before.split("::").map(|segment| segment.trim().to_owned()).filter(|segment| !segment.is_empty()));
    let inner = &tree[open + 1..tree.rfind('}').unwrap_or(tree.len())];
    let (mut depth, mut start) = (0, 0);
    for (at, letter) in inner.char_indices() {
        match letter {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                expand(&inner[start..at], &prefix, found);
                start = at + 1;
            }
            _ => {}
        }
    }
    expand(&inner[start..], &prefix, found);
}
