//! Pictures of maps: a shaded top view with graphs and tracks drawn over it.

use anyhow::Context;
use std::io::BufWriter;
use std::path::Path;
use surefoot_world::mesh::Surface;
use surefoot_world::{Map, Vec3};

/// A top view, one colour per pixel; x grows to the right, z downwards.
pub struct Picture {
    width: u32,
    height: u32,
    pixels_per_m: f32,
    rgb: Vec<u8>,
}

/// An RGB colour.
pub type Colour = [u8; 3];

impl Picture {
    /// Casts one ray down through each pixel.
    pub fn top_view(map: &Map, pixels_per_m: f32) -> Self {
        let extent = map.extent();
        let (width, height) = ((extent.x * pixels_per_m) as u32, (extent.z * pixels_per_m) as u32);
        let mut rgb = Vec::with_capacity((width * height * 3) as usize);
        for j in 0..height {
            for i in 0..width {
                let (x, z) = ((i as f32 + 0.5) / pixels_per_m, (j as f32 + 0.5) / pixels_per_m);
                rgb.extend(ground_colour(map, x, z));
            }
        }
        Self { width, height, pixels_per_m, rgb }
    }

    /// Draws a straight line between two points of the map.
    pub fn line(&mut self, from: Vec3, to: Vec3, colour: Colour, opacity: f32) {
        let length = (to.x - from.x).hypot(to.z - from.z) * self.pixels_per_m;
        let steps = length.ceil().max(1.0) as u32;
        for step in 0..=steps {
            let point = from + (to - from) * (step as f32 / steps as f32);
            self.blend(point.x * self.pixels_per_m, point.z * self.pixels_per_m, colour, opacity);
        }
    }

    /// Draws a filled disc of `radius` pixels around a point of the map.
    pub fn dot(&mut self, at: Vec3, radius: f32, colour: Colour) {
        let (x, z) = (at.x * self.pixels_per_m, at.z * self.pixels_per_m);
        let reach = radius.ceil() as i32;
        for dz in -reach..=reach {
            for dx in -reach..=reach {
                if ((dx * dx + dz * dz) as f32) <= radius * radius {
                    self.blend(x + dx as f32, z + dz as f32, colour, 1.0);
                }
            }
        }
    }

    fn blend(&mut self, x: f32, z: f32, colour: Colour, opacity: f32) {
        if x < 0.0 || z < 0.0 || x >= self.width as f32 || z >= self.height as f32 {
            return;
        }
        let start = (z as u32 * self.width + x as u32) as usize * 3;
        for (channel, value) in colour.iter().enumerate() {
            let old = f32::from(self.rgb[start + channel]);
            self.rgb[start + channel] = (old + (f32::from(*value) - old) * opacity) as u8;
        }
    }

    /// Writes a PNG file.
    pub fn save(&self, path: &Path) -> anyhow::Result<()> {
        let file = std::fs::File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
        let mut encoder = png::Encoder::new(BufWriter::new(file), self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(png::Compression::High);
        encoder.write_header()?.write_image_data(&self.rgb)?;
        Ok(())
    }
}

fn ground_colour(map: &Map, x: f32, z: f32) -> Colour {
    let sun = Vec3::new(-0.4, 0.8, -0.45);
    let top = map.extent().y - 0.01;
    let down = Vec3::new(0.000_31, -0.999_999_9, 0.000_23);
    let Some(hit) = map.mesh().cast_ray(Vec3::new(x, top, z), down, top + 1.0) else {
        return [20, 20, 24];
    };
    let normal = map.mesh().triangles()[hit.triangle_idx as usize].normal();
    let height = ((top - hit.distance) / 50.0).clamp(0.0, 1.0);
    let roof = map.buildings().iter().any(|b| x > b.min.x && x < b.max.x && z > b.min.z && z < b.max.z);
    let base = match hit.surface {
        Surface::Water => [50.0, 110.0, 220.0],
        Surface::Lava => [245.0, 90.0, 20.0],
        Surface::Pad => [255.0, 225.0, 40.0],
        Surface::Ground if roof => [190.0, 170.0, 160.0],
        Surface::Ground if normal.y < 0.819 => [125.0, 105.0, 95.0],
        Surface::Ground => [85.0 + height * 130.0, 125.0 + height * 70.0, 78.0 + height * 110.0],
    };
    let light = 0.3 + 0.75 * normal.dot(sun).max(0.0);
    base.map(|channel: f32| (channel * light).min(255.0) as u8)
}
