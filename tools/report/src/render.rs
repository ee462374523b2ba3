//! Pictures of maps: shaded views from above, from a corner and of a section, with graphs and tracks drawn over them.

use crate::ReportError;
use font8x8::legacy::BASIC_LEGACY;
use rayon::prelude::*;
use std::io::{BufWriter, Write};
use std::path::Path;
use surefoot_world::mesh::{RayHit, Surface};
use surefoot_world::navigable::DOWN;
use surefoot_world::reach::ground::Ground;
use surefoot_world::{Ability, Map, Motion, Vec3};

/// View of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum View {
    /// Straight down; x grows to the right, z downwards.
    Top,
    /// From a corner, in parallel projection.
    Iso,
    /// Straight down, without everything above this height, m; cut rock and walls are dark.
    Section(f32),
}

/// An RGB colour, 8 bits per channel.
pub type Colour = [u8; 3];

/// Direction towards the sun: the upper left in views from above, and beside the camera in views from a corner.
const SUN: Vec3 = Vec3::new(-0.4, 0.8, -0.45);
const SUN_BESIDE: Vec3 = Vec3::new(0.75, 0.8, 0.2);
/// Height of a row of the legend, in pixels.
const LEGEND_ROW: u32 = 22;
/// Side of a glyph, in pixels.
const GLYPH: u32 = 8;

/// Parallel projection of the map onto the picture.
#[derive(Debug, Clone, Copy)]
struct Projection {
    /// Unit direction of view.
    sight: Vec3,
    /// Unit vectors to the right and down in the picture.
    right: Vec3,
    down: Vec3,
    /// Coordinates of the picture's upper left corner along `right` and `down`, m.
    corner: (f32, f32),
    pixels_per_m: f32,
}

impl Projection {
    fn pixel(&self, point: Vec3) -> (f32, f32) {
        let (x, y) = (self.right.dot(point) - self.corner.0, self.down.dot(point) - self.corner.1);
        (x * self.pixels_per_m, y * self.pixels_per_m)
    }

    /// A point on the line of view through the centre of a pixel.
    fn point(&self, x: u32, y: u32) -> Vec3 {
        let x = (x as f32 + 0.5) / self.pixels_per_m + self.corner.0;
        let y = (y as f32 + 0.5) / self.pixels_per_m + self.corner.1;
        self.right * x + self.down * y
    }
}

/// A picture of a map.
pub struct Picture {
    width: u32,
    height: u32,
    projection: Projection,
    rgb: Vec<u8>,
}

impl Picture {
    /// Draws `map` from above.
    pub fn top_view(map: &Map, pixels_per_m: f32) -> Self {
        Self::of(map, View::Top, pixels_per_m, None)
    }

    /// Draws `map`. With `islands`, ground that is connected on foot has one colour.
    pub fn of(map: &Map, view: View, pixels_per_m: f32, islands: Option<&Ground>) -> Self {
        let extent = map.extent();
        let mut projection =
            Projection { sight: DOWN, right: Vec3::X, down: Vec3::Z, corner: (0.0, 0.0), pixels_per_m };
        let (mut width, mut height) = (extent.x, extent.z);
        if view == View::Iso {
            let sight = Vec3::new(-1.0, -0.85, -1.0).normalize();
            let right = sight.cross(Vec3::Y).normalize();
            let down = sight.cross(right);
            projection = Projection { sight, right, down, ..projection };
            // The highest ground determines how much sky the picture shows.
            let top = map.mesh().triangles().iter().flat_map(|t| t.corners()).map(|c| c.y).fold(0.0, f32::max);
            let corners = [0.0, extent.x]
                .into_iter()
                .flat_map(|x| [0.0, top].into_iter().flat_map(move |y| [0.0, extent.z].map(|z| Vec3::new(x, y, z))));
            let (mut low, mut high) = ((f32::INFINITY, f32::INFINITY), (f32::NEG_INFINITY, f32::NEG_INFINITY));
            for corner in corners {
                let (x, y) = (right.dot(corner), down.dot(corner));
                low = (low.0.min(x), low.1.min(y));
                high = (high.0.max(x), high.1.max(y));
            }
            projection.corner = low;
            (width, height) = (high.0 - low.0, high.1 - low.1);
        }
        let (width, height) = ((width * pixels_per_m) as u32, (height * pixels_per_m) as u32);
        let mut picture = Self { width, height, projection, rgb: vec![0; (width * height * 3) as usize] };
        let row_bytes = (width as usize * 3).max(1);
        picture.rgb.par_chunks_exact_mut(row_bytes).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
                let point = projection.point(x as u32, y as u32);
                pixel.copy_from_slice(&colour_at(map, view, &projection, point, islands));
            }
        });
        for line in &map.placed().zip_lines {
            let [_, hung, end] = line.path();
            picture.line(hung, end, [255, 80, 200], 0.9);
            picture.dot(end, 2.0, [255, 80, 200]);
        }
        for teleporter in &map.placed().teleporters {
            picture.line(teleporter.from, teleporter.to, [150, 80, 255], 0.35);
        }
        picture
    }

    /// Draws a straight line between two points of the map, with an opacity in [0, 1].
    pub fn line(&mut self, from: Vec3, to: Vec3, colour: Colour, opacity: f32) {
        let ((x0, y0), (x1, y1)) = (self.projection.pixel(from), self.projection.pixel(to));
        let steps = (x1 - x0).hypot(y1 - y0).ceil().max(1.0) as u32;
        for step in 0..=steps {
            let t = step as f32 / steps as f32;
            self.blend(x0 + (x1 - x0) * t, y0 + (y1 - y0) * t, colour, opacity);
        }
    }

    /// Draws a filled disc of `radius` pixels around a point of the map.
    pub fn dot(&mut self, at: Vec3, radius: f32, colour: Colour) {
        let (x, y) = self.projection.pixel(at);
        let reach = radius.ceil() as i32;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                if ((dx * dx + dy * dy) as f32) <= radius * radius {
                    self.blend(x + dx as f32, y + dy as f32, colour, 1.0);
                }
            }
        }
    }

    /// Adds a legend with a title and the meaning of the colours below the picture.
    pub fn add_legend(&mut self, title: &str, entries: &[(Colour, &str)]) {
        let wide = |text: &str| text.len() as u32 * GLYPH;
        let mut places = Vec::new();
        let (mut x, mut row) = (wide(title) + 3 * GLYPH, 0);
        for (colour, text) in entries {
            let needed = wide(text) + 4 * GLYPH;
            if x + needed > self.width && x > GLYPH {
                (x, row) = (GLYPH, row + 1);
            }
            places.push((x, row, *colour, *text));
            x += needed;
        }
        let top = self.height;
        self.height += (row + 1) * LEGEND_ROW;
        self.rgb.resize((self.width * self.height * 3) as usize, 24);
        let middle = (LEGEND_ROW - GLYPH) / 2;
        self.text(GLYPH, top + middle, title);
        for (x, row, colour, text) in places {
            let y = top + row * LEGEND_ROW + middle;
            for dy in 0..GLYPH {
                for dx in 0..GLYPH + 4 {
                    self.blend((x + dx) as f32, (y + dy) as f32, colour, 1.0);
                }
            }
            self.text(x + 2 * GLYPH, y, text);
        }
    }

    fn text(&mut self, x: u32, y: u32, text: &str) {
        for (position, byte) in (0..).zip(text.bytes()) {
            let glyph = BASIC_LEGACY[usize::from(byte) % BASIC_LEGACY.len()];
            for (dy, bits) in (0..).zip(glyph) {
                for dx in (0..GLYPH).filter(|dx| bits & (1 << dx) != 0) {
                    self.blend((x + position * GLYPH + dx) as f32, (y + dy) as f32, [230, 230, 235], 1.0);
                }
            }
        }
    }

    fn blend(&mut self, x: f32, y: f32, colour: Colour, opacity: f32) {
        if x < 0.0 || y < 0.0 || x >= self.width as f32 || y >= self.height as f32 {
            return;
        }
        let start = (y as u32 * self.width + x as u32) as usize * 3;
        for (channel, value) in colour.iter().enumerate() {
            let old = f32::from(self.rgb[start + channel]);
            self.rgb[start + channel] = (old + (f32::from(*value) - old) * opacity) as u8;
        }
    }

    /// Draws a graph: its edges in the colours of the abilities that they need, then its vertices; positions are in m.
    pub fn graph(&mut self, vertices: impl Iterator<Item = Vec3>, edges: impl Iterator<Item = (Vec3, Vec3, Ability)>) {
        edges.for_each(|(from, to, ability)| self.line(from, to, ability_colour(ability), 0.16));
        vertices.for_each(|at| self.dot(at, 1.5, [250, 250, 250]));
    }

    /// Writes a PNG file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), ReportError> {
        let file = std::fs::File::create(path).map_err(|error| ReportError::Write(path.to_owned(), error))?;
        let written = self.encode(BufWriter::new(file), png::Compression::High);
        written.map_err(|error| ReportError::Draw(path.to_owned(), error.to_string()))
    }

    /// The picture as the content of a PNG file, which is made quickly rather than small.
    pub fn to_png(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.encode(&mut bytes, png::Compression::Fast).expect("writing to memory does not fail");
        bytes
    }

    fn encode(&self, to: impl Write, compression: png::Compression) -> Result<(), png::EncodingError> {
        let mut encoder = png::Encoder::new(to, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(compression);
        encoder.write_header()?.write_image_data(&self.rgb)
    }
}

/// Colour of the edges that need an ability.
fn ability_colour(ability: Ability) -> Colour {
    match ability.motion() {
        Motion::Walk => [240, 240, 240],
        Motion::Jump => [90, 220, 255],
        Motion::AirJump => [70, 120, 255],
        Motion::Throw => [255, 220, 60],
        Motion::Ride => [255, 80, 200],
        Motion::Teleport => [150, 80, 255],
        Motion::Thrust => [80, 255, 220],
        Motion::Surface => [190, 150, 70],
        Motion::Pull => [230, 120, 60],
        Motion::Swim => [60, 160, 230],
        Motion::Crouch => [150, 170, 150],
        Motion::Dash => [255, 90, 90],
        Motion::WallRun => [255, 150, 120],
        Motion::Slide => [180, 200, 120],
        Motion::Dive => [30, 110, 190],
        Motion::Own => [255, 120, 255],
    }
}

/// How a surface other than rock is drawn: its colour in full light, its colour in legends, and its name there.
fn look(surface: Surface) -> Option<([f32; 3], Colour, &'static str)> {
    Some(match surface {
        Surface::Ground => return None,
        Surface::Climb => ([170.0, 130.0, 60.0], [190, 150, 70], "ladder"),
        Surface::Water => ([50.0, 110.0, 220.0], [50, 110, 220], "water"),
        Surface::Lava => ([265.0, 100.0, 20.0], [245, 90, 20], "lava"),
        Surface::Pad => ([275.0, 240.0, 40.0], [255, 225, 40], "jump pad"),
        Surface::ZipLine => ([255.0, 80.0, 200.0], [255, 80, 200], "zip line"),
        Surface::Teleporter => ([160.0, 90.0, 265.0], [150, 80, 255], "teleporter"),
        Surface::Jetpack => ([80.0, 265.0, 225.0], [80, 255, 220], "jetpack"),
    })
}

/// Legend of a picture of `map`: the colours of what is on the map, with names.
pub fn legend(map: &Map) -> Vec<(Colour, &'static str)> {
    let placed = map.placed();
    let pools = placed.pools.iter().map(|pool| Surface::from(pool.liquid));
    let on_map: Vec<Surface> = pools.chain(placed.devices().map(|device| device.kind.surface())).collect();
    let looks = Surface::ALL.iter().filter(|surface| on_map.contains(surface)).filter_map(|surface| look(*surface));
    let building = (!placed.buildings.is_empty()).then_some(([190, 170, 160], "building"));
    let ground = [([120, 145, 110], "ground"), ([125, 105, 95], "too steep")].into_iter().chain(building);
    ground.chain(looks.map(|(_, colour, name)| (colour, name))).collect()
}

fn colour_at(map: &Map, view: View, projection: &Projection, point: Vec3, islands: Option<&Ground>) -> Colour {
    const SKY: Colour = [20, 20, 24];
    const FAR_M: f32 = 4000.0;
    let (origin, reach) = match view {
        View::Top => (point + Vec3::new(0.0, map.extent().y - 0.01, 0.0), FAR_M),
        View::Iso => (point - projection.sight * 0.5 * FAR_M, FAR_M),
        View::Section(y) => {
            let at = point + Vec3::new(0.0, y, 0.0);
            if map.mesh().solid_depth_at(at) > 0 {
                return [52, 46, 48];
            }
            (at, FAR_M)
        }
    };
    let Some(hit) = map.mesh().cast_ray(origin, projection.sight, reach) else { return SKY };
    let place = origin + projection.sight * hit.distance;
    let normal = map.mesh().triangles()[hit.triangle_idx as usize].normal();
    let facing = if normal.dot(projection.sight) > 0.0 { -normal } else { normal };
    let sun = if view == View::Iso { SUN_BESIDE } else { SUN }.normalize();
    let shade = map.mesh().cast_ray(place + facing * 0.05, sun, 150.0).is_some_and(|hit| hit.surface.is_solid());
    let direct = if shade { 0.0 } else { facing.dot(sun).max(0.0) };
    let light = 0.36 + 0.12 * facing.y.max(0.0) + 0.62 * direct;
    base_colour(map, place, facing, hit, islands).map(|channel| (channel * light).min(255.0) as u8)
}

/// Colour of a place in full light.
fn base_colour(map: &Map, place: Vec3, normal: Vec3, hit: RayHit, islands: Option<&Ground>) -> [f32; 3] {
    let height = (place.y / 60.0).clamp(0.0, 1.0);
    let is_walkable = normal.y > 0.819;
    // The point is slightly inside the hit surface, so that walls belong to their building.
    let inside = place - normal * 0.1;
    let on_building = || {
        map.placed().buildings.iter().any(|building| {
            building.covers(inside.x, inside.z)
                && inside.y > building.base.y - 0.2
                && inside.y < building.base.y + building.height
        })
    };
    if let Some((colour, ..)) = look(hit.surface) {
        return colour;
    }
    if let Some(cell) = islands.filter(|_| is_walkable).and_then(|ground| ground.at(place)) {
        return island_colour(cell.island);
    }
    match (on_building(), is_walkable) {
        (true, true) => [200.0, 178.0, 168.0],
        (true, false) => [168.0, 146.0, 138.0],
        (false, true) => [92.0 + height * 120.0, 132.0 + height * 62.0, 82.0 + height * 104.0],
        (false, false) => [128.0, 108.0, 97.0],
    }
}

/// Colour of an island, clearly different for each of the larger islands.
fn island_colour(island: u32) -> [f32; 3] {
    // The golden angle separates the hues of neighbours in the list.
    let hue = (island as f32 * 0.618_034).fract() * 6.0;
    let ramp = |offset: f32| {
        let distance = ((hue + offset).rem_euclid(6.0) - 3.0).abs();
        (distance - 1.0).clamp(0.0, 1.0)
    };
    [ramp(0.0), ramp(4.0), ramp(2.0)].map(|channel| 90.0 + 150.0 * channel)
}
