//! Reads Wavefront OBJ into a scene: objects and groups become nodes.
//!
//! Only positions, faces, polylines and names are read. The file is read twice, because faces may come before their
//! vertices: the first pass collects the vertices, the second one builds the nodes. Start at [`read`]; [`Statements`]
//! knows the syntax of lines, [`Builder`] their meaning, and `polygon` splits faces into triangles.

use crate::faults::{ImportError, MAX_TRIANGLES};
use crate::polygon::Splitter;
use crate::scene::{Node, Scene};
use glam::DVec3;
use std::borrow::Cow;
use std::str::FromStr;

pub(super) fn read(bytes: &[u8]) -> Result<Scene, ImportError> {
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err(ImportError::Obj("its text is UTF-16: save it as UTF-8".to_owned()));
    }
    let vertices = vertices(bytes)?;
    let mut builder = Builder::new(&vertices);
    for (line, statement) in Statements::new(bytes) {
        builder.add(line, &statement)?;
    }
    let has_faces = builder.face_count > 0;
    let nodes = builder.finish();
    if !has_faces && nodes.is_empty() {
        return Err(ImportError::Obj("it has no faces (lines that begin with `f`): export the level again".to_owned()));
    }
    Ok(Scene { nodes, former_size: None })
}

fn fault(line: usize, problem: &str) -> ImportError {
    ImportError::Obj(format!("line {line}: {problem}"))
}

/// All vertices of the file. A weight or a colour after the coordinates is ignored.
fn vertices(bytes: &[u8]) -> Result<Vec<DVec3>, ImportError> {
    const PROBLEM: &str =
        "a `v` line does not begin with three finite numbers: correct the line or export the level again";
    let mut vertices = Vec::new();
    for (line, statement) in Statements::new(bytes) {
        let (keyword, rest) = split_keyword(&statement);
        if keyword == b"v" {
            let mut numbers = words(rest).map(|word| parse::<f64>(word).filter(|number| number.is_finite()));
            let mut next = || numbers.next().flatten();
            let (Some(x), Some(y), Some(z)) = (next(), next(), next()) else {
                let hint = if rest.contains(&b',') { "; write decimal points, not commas" } else { "" };
                return Err(fault(line, &format!("{PROBLEM}{hint}")));
            };
            vertices.push(DVec3::new(x, y, z));
        }
    }
    Ok(vertices)
}

/// Builds nodes from statements.
struct Builder<'a> {
    /// All vertices of the file.
    vertices: &'a [DVec3],
    /// Number of vertices so far: negative references count back from here.
    vertex_count: usize,
    /// Number of faces so far.
    face_count: usize,
    /// Number of triangles so far.
    triangle_count: usize,
    nodes: Vec<Node<DVec3>>,
    /// The node that elements belong to.
    node: Node<DVec3>,
    /// Corners of the current element.
    corners: Vec<DVec3>,
    splitter: Splitter,
}

impl<'a> Builder<'a> {
    fn new(vertices: &'a [DVec3]) -> Self {
        Self {
            vertices,
            vertex_count: 0,
            face_count: 0,
            triangle_count: 0,
            nodes: Vec::new(),
            node: Node::default(),
            corners: Vec::new(),
            splitter: Splitter::new(),
        }
    }

    fn add(&mut self, line: usize, statement: &[u8]) -> Result<(), ImportError> {
        let (keyword, rest) = split_keyword(statement);
        match keyword {
            b"v" => self.vertex_count += 1,
            b"f" => self.add_face(line, rest)?,
            b"l" => self.add_polyline(line, rest)?,
            b"p" | b"curv" | b"curv2" | b"surf" => self.node.skipped_count += 1,
            b"o" | b"g" => self.start_node(rest),
            _ => {}
        }
        Ok(())
    }

    /// Ends the current node. Without triangles it is no node, and what it skipped counts for the next one.
    fn start_node(&mut self, name: &[u8]) {
        self.end_node();
        self.node.name = String::from_utf8_lossy(name).into_owned();
    }

    fn end_node(&mut self) {
        if !self.node.triangles.is_empty() {
            self.node.file_idx = self.nodes.len();
            self.nodes.push(std::mem::take(&mut self.node));
        }
    }

    fn finish(mut self) -> Vec<Node<DVec3>> {
        self.end_node();
        if let Some(last) = self.nodes.last_mut() {
            last.skipped_count += self.node.skipped_count;
        }
        self.nodes
    }

    fn add_face(&mut self, line: usize, rest: &[u8]) -> Result<(), ImportError> {
        self.face_count += 1;
        let face = self.face_count;
        self.collect_corners(rest).map_err(|problem| fault(line, &format!("face {face} {problem}")))?;
        self.count_triangles(self.corners.len().saturating_sub(2))?;
        if self.corners.len() > 3 {
            self.corners.dedup();
            if self.corners.first() == self.corners.last() {
                self.corners.pop();
            }
        }
        let corner_count = self.corners.len();
        if corner_count < 3 {
            self.node.skipped_count += 1;
            return Ok(());
        }
        self.splitter.split(&self.corners, &mut self.node.triangles).map_err(|_| {
            let problem = "corners, too many for faces that are not convex: triangulate the level on export";
            fault(line, &format!("face {face} has {corner_count} {problem}"))
        })
    }

    /// Adds triangles without area: they are not solid, but they count towards the bounds of features.
    fn add_polyline(&mut self, line: usize, rest: &[u8]) -> Result<(), ImportError> {
        self.collect_corners(rest).map_err(|problem| fault(line, &format!("the polyline {problem}")))?;
        if self.corners.len() < 2 {
            self.node.skipped_count += 1;
            return Ok(());
        }
        self.count_triangles(self.corners.len() - 1)?;
        self.node.triangles.extend(self.corners.windows(2).map(|ends| [ends[0], ends[1], ends[1]]));
        Ok(())
    }

    fn count_triangles(&mut self, count: usize) -> Result<(), ImportError> {
        self.triangle_count += count;
        if self.triangle_count > MAX_TRIANGLES { Err(ImportError::TooManyTriangles) } else { Ok(()) }
    }

    /// Makes `corners` the vertices that an element refers to.
    fn collect_corners(&mut self, rest: &[u8]) -> Result<(), String> {
        self.corners.clear();
        // More corners are too many triangles, which `count_triangles` refuses.
        for word in words(rest).take(MAX_TRIANGLES + 3) {
            let corner = self.corner(word)?;
            self.corners.push(corner);
        }
        Ok(())
    }

    /// The vertex that a word such as `7/1/2` refers to: the number before the first slash counts from 1, or backwards
    /// from -1 for the latest vertex.
    fn corner(&self, word: &[u8]) -> Result<DVec3, String> {
        let number = word.split(|byte| *byte == b'/').next().and_then(parse::<i64>);
        let number = number.ok_or("does not hold vertex numbers: write it like `f 1 2 3` or export the level again")?;
        let idx = if number < 0 { self.vertex_count as i64 + number } else { number - 1 };
        let vertex = usize::try_from(idx).ok().and_then(|idx| self.vertices.get(idx));
        vertex.copied().ok_or_else(|| {
            let limit = match number {
                ..0 => format!("only {} come before it", self.vertex_count),
                0 => "the first vertex is 1".to_owned(),
                1.. => format!("the file has only {}", self.vertices.len()),
            };
            format!("refers to vertex {number}, but {limit}: export the level again")
        })
    }
}

/// The statements of a file, each with the number of its first line, without comments and with continued lines joined.
/// Lines end with LF, CR LF or CR.
struct Statements<'a> {
    rest: &'a [u8],
    /// Number of lines before `rest`.
    line_count: usize,
}

impl<'a> Statements<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), line_count: 0 }
    }

    fn next_line(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        self.line_count += 1;
        let end = self.rest.iter().position(|byte| matches!(byte, b'\n' | b'\r')).unwrap_or(self.rest.len());
        let (line, rest) = self.rest.split_at(end);
        let break_len = if rest.starts_with(b"\r\n") { 2 } else { 1 };
        self.rest = rest.get(break_len..).unwrap_or_default();
        Some(line)
    }
}

impl<'a> Iterator for Statements<'a> {
    type Item = (usize, Cow<'a, [u8]>);

    fn next(&mut self) -> Option<Self::Item> {
        let first = self.next_line()?;
        let line = self.line_count;
        let is_name = matches!(split_keyword(first).0, b"o" | b"g");
        let (content, mut is_continued) = split_end(first, is_name);
        // Folders such as `mtllib C:\levels\` end so as well.
        is_continued &= match split_keyword(content) {
            (b"usemtl" | b"mtllib", _) => false,
            (b"o" | b"g", name) => name.is_empty(),
            _ => true,
        };
        let mut statement = Cow::Borrowed(content);
        while is_continued {
            let Some(next) = self.next_line() else { break };
            let (content, is_more) = split_end(next, is_name);
            let joined = statement.to_mut();
            joined.push(b' ');
            joined.extend_from_slice(content);
            is_continued = is_more;
        }
        Some((line, statement))
    }
}

/// A line without its comment, and whether the next line continues it. In a name, a comment begins after a space only:
/// `Wall#3` is a name.
fn split_end(line: &[u8], is_name: bool) -> (&[u8], bool) {
    let is_comment = |&at: &usize| line[at] == b'#' && (!is_name || at == 0 || line[at - 1].is_ascii_whitespace());
    let end = (0..line.len()).find(is_comment).unwrap_or(line.len());
    let content = line[..end].trim_ascii();
    match content.strip_suffix(b"\\") {
        Some(content) => (content, true),
        None => (content, false),
    }
}

/// The first word of a statement, and the rest.
fn split_keyword(statement: &[u8]) -> (&[u8], &[u8]) {
    let statement = statement.trim_ascii();
    let end = statement.iter().position(u8::is_ascii_whitespace).unwrap_or(statement.len());
    let (keyword, rest) = statement.split_at(end);
    (keyword, rest.trim_ascii())
}

fn words(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

fn parse<T: FromStr>(word: &[u8]) -> Option<T> {
    std::str::from_utf8(word).ok()?.parse().ok()
}
