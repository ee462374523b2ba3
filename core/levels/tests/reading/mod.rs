//! What glTF files may hold: each is compared with a plain file of the same level.

use crate::{PLAIN, corners, glb, gltf, gltf_level, refusal};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;
use surefoot_levels::{Files, ImportError, ImportOptions, Imported, NoFiles, UpAxis};
use surefoot_world::Vec3;
use surefoot_world::map::LevelFrame;

/// A document with its binary data, to which tests add.
struct Level {
    json: Value,
    binary: Vec<u8>,
}

impl Level {
    /// A floor of 20 x 20 m in two triangles, as the mesh 0, with one node for each in `nodes`.
    fn new(nodes: Value) -> Self {
        let mut level = Self {
            json: json!({
                "asset": { "version": "2.0" },
                "scene": 0,
                "scenes": [{ "nodes": (0..nodes.as_array().map_or(0, Vec::len)).collect::<Vec<_>>() }],
                "nodes": nodes,
                "accessors": [],
                "bufferViews": [],
                "meshes": [],
            }),
            binary: Vec::new(),
        };
        let corners = [[0.0f32, 0.0, 0.0], [0.0, 0.0, 20.0], [20.0, 0.0, 20.0], [20.0, 0.0, 0.0]];
        let positions = level.floats("VEC3", &corners);
        let indices = level.accessor("SCALAR", 5123, 6, &[0u16, 1, 2, 0, 2, 3].map(u16::to_le_bytes).concat());
        level.json["meshes"] =
            json!([{ "primitives": [{ "attributes": { "POSITION": positions }, "indices": indices }] }]);
        level
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let view = json!({ "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len() });
        self.binary.extend(bytes);
        let views = self.json["bufferViews"].as_array_mut().expect("an array");
        views.push(view);
        views.len() - 1
    }

    fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        self.add_accessor(json!({ "bufferView": view, "componentType": component, "count": count, "type": kind }))
    }

    fn add_accessor(&mut self, accessor: Value) -> usize {
        let accessors = self.json["accessors"].as_array_mut().expect("an array");
        accessors.push(accessor);
        accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, kind: &str, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values.as_flattened().iter().copied().flat_map(f32::to_le_bytes).collect();
        self.accessor(kind, 5126, values.len(), &bytes)
    }

    fn add_mesh(&mut self, mesh: Value) {
        self.json["meshes"].as_array_mut().expect("an array").push(mesh);
    }

    fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "byteLength": self.binary.len() }]);
        glb(&json, Some(&self.binary))
    }

    fn import(&self) -> Imported {
        import(&self.glb()).expect("a valid level")
    }
}

fn import(bytes: &[u8]) -> Result<Imported, ImportError> {
    surefoot_levels::import_gltf(bytes, None, &PLAIN, &NoFiles)
}

/// Asserts that two levels have the same triangles, within rounding.
fn assert_same(one: &Imported, other: &Imported) {
    let (one, other) = (corners(&one.map), corners(&other.map));
    assert_eq!(one.len(), other.len());
    for (one, other) in one.iter().flatten().zip(other.iter().flatten()) {
        assert!(one.distance(*other) < 1.0e-3, "{one} {other}");
    }
}

#[test]
fn scenes_without_nodes_are_empty_and_all_scenes_are_read_on_request() {
    let one = Level::new(json!([{ "mesh": 0 }, { "mesh": 0, "translation": [30, 2, 0] }]));
    let whole = one.import();
    for (default, scenes) in
        [(0, json!([{ "nodes": [0, 1] }, { "name": "empty" }])), (1, json!([{}, { "nodes": [0, 1] }]))]
    {
        let mut level = Level::new(one.json["nodes"].clone());
        (level.json["scene"], level.json["scenes"]) = (json!(default), scenes);
        assert_eq!(level.import().map.hash(), whole.map.hash());
    }
    let mut split = Level::new(one.json["nodes"].clone());
    split.json["scenes"] = json!([{ "nodes": [0] }, { "nodes": [1] }]);
    assert_eq!(corners(&split.import().map).len(), 2);
    let all = ImportOptions { all_scenes: true, ..PLAIN };
    let all = surefoot_levels::import_gltf(&split.glb(), None, &all, &NoFiles).expect("a valid level");
    assert_eq!(all.map.hash(), whole.map.hash());
}

#[test]
fn sparse_accessors_replace_elements_of_a_view_or_of_zeros() {
    let plain = {
        let mut level = Level::new(json!([{ "mesh": 0 }, { "mesh": 1 }]));
        let raised = level.floats("VEC3", &[[0.0, 0.0, 30.0], [0.0, 5.0, 50.0], [20.0, 0.0, 50.0]]);
        level.add_mesh(json!({ "primitives": [{ "attributes": { "POSITION": raised } }] }));
        level.import()
    };
    for with_view in [true, false] {
        let mut level = Level::new(json!([{ "mesh": 0 }, { "mesh": 1 }]));
        let indices: &[u16] = if with_view { &[1] } else { &[0, 1, 2] };
        let all = [[0.0f32, 0.0, 30.0], [0.0, 5.0, 50.0], [20.0, 0.0, 50.0]];
        let values: Vec<u8> =
            indices.iter().flat_map(|idx| all[usize::from(*idx)]).flat_map(f32::to_le_bytes).collect();
        let values = level.view(&values);
        let index_view = level.view(&indices.iter().copied().flat_map(u16::to_le_bytes).collect::<Vec<_>>());
        let mut accessor = json!({
            "componentType": 5126, "count": 3, "type": "VEC3",
            "sparse": {
                "count": indices.len(),
                "indices": { "bufferView": index_view, "componentType": 5123 },
                "values": { "bufferView": values },
            },
        });
        if with_view {
            let base: Vec<u8> = [[0.0f32, 0.0, 30.0], [9.0, 9.0, 9.0], [20.0, 0.0, 50.0]]
                .into_iter()
                .flatten()
                .flat_map(f32::to_le_bytes)
                .collect();
            accessor["bufferView"] = json!(level.view(&base));
        }
        let positions = level.add_accessor(accessor);
        level.add_mesh(json!({ "primitives": [{ "attributes": { "POSITION": positions } }] }));
        assert_eq!(level.import().map.hash(), plain.map.hash());

        level.json["accessors"][positions]["sparse"]["count"] = json!(1_u64 << 40);
        let error = refusal(import(&level.glb()), "does not fit");
        assert!(error.contains("sparse data that does not fit"), "{error}");
    }
}

#[test]
fn instances_repeat_a_mesh_with_floats_and_with_normalized_turns() {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let nodes = json!([
        { "mesh": 0 },
        { "translation": [10, 1, 0], "children": [2] },
        { "mesh": 0, "translation": [30, 0, 0], "rotation": [0, half, 0, half], "scale": [0.5, 1, 0.5] },
        { "translation": [10, 1, 0], "children": [4] },
        { "mesh": 0, "translation": [60, 0, 40] },
    ]);
    let mut plain = Level::new(nodes);
    plain.json["scenes"][0]["nodes"] = json!([0, 1, 3]);
    let plain = plain.import();
    for normalized in [false, true] {
        let mut level = Level::new(json!([{ "mesh": 0 }, { "mesh": 0, "translation": [10, 1, 0] }]));
        let translation = level.floats("VEC3", &[[30.0, 0.0, 0.0], [60.0, 0.0, 40.0]]);
        let scale = level.floats("VEC3", &[[0.5, 1.0, 0.5], [1.0, 1.0, 1.0]]);
        let turns = [[0.0, half, 0.0, half], [0.0, 0.0, 0.0, 1.0]];
        let rotation = if normalized {
            let shorts = turns.as_flattened().iter().map(|value| (value * 32767.0).round() as i16);
            let bytes: Vec<u8> = shorts.flat_map(i16::to_le_bytes).collect();
            let rotation = level.accessor("VEC4", 5122, 2, &bytes);
            level.json["accessors"][rotation]["normalized"] = json!(true);
            rotation
        } else {
            level.floats("VEC4", &turns)
        };
        let attributes = json!({ "TRANSLATION": translation, "ROTATION": rotation, "SCALE": scale });
        level.json["nodes"][1]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
        level.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
        assert_same(&level.import(), &plain);
    }
}

#[test]
fn skins_stand_in_their_pose_and_morph_targets_at_their_weights() {
    let plain = Level::new(json!([{ "mesh": 0 }, { "mesh": 0, "translation": [5, 3, 40] }])).import();
    // The node itself is elsewhere: only the joints count.
    let mut skinned = Level::new(json!([
        { "mesh": 0 },
        { "name": "bridge", "mesh": 1, "skin": 0, "translation": [0, 0, 500] },
        { "translation": [0, 1, 10] , "children": [3] },
        { "translation": [5, 4, 30] },
    ]));
    skinned.json["scenes"][0]["nodes"] = json!([0, 1, 2]);
    // Bound 2 m higher than the mesh.
    let bound =
        skinned.floats("MAT4", &[[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -2.0, 0.0, 1.0]]);
    let joints = skinned.accessor("VEC4", 5121, 4, &[0; 16]);
    let weights = skinned.floats("VEC4", &[[0.5, 0.5, 0.0, 0.0]; 4]);
    skinned.json["skins"] = json!([{ "joints": [3], "inverseBindMatrices": bound }]);
    let attributes = json!({ "POSITION": 0, "JOINTS_0": joints, "WEIGHTS_0": weights });
    skinned.add_mesh(json!({ "primitives": [{ "attributes": attributes, "indices": 1 }] }));
    assert_same(&skinned.import(), &plain);

    let mut morphed = Level::new(json!([{ "mesh": 0 }, { "mesh": 1, "translation": [0, 0, 40] }]));
    let shifts = morphed.floats("VEC3", &[[10.0, 6.0, 0.0]; 4]);
    let far = morphed.floats("VEC3", &[[900.0, 0.0, 0.0]; 4]);
    morphed.add_mesh(json!({
        "primitives": [{
            "attributes": { "POSITION": 0 }, "indices": 1, "targets": [{ "POSITION": shifts }, { "POSITION": far }],
        }],
        "weights": [0.5, 0.0],
    }));
    assert_same(&morphed.import(), &plain);
}

#[test]
fn containers_may_hold_marks_padding_and_chunks_of_other_kinds() {
    let level = Level::new(json!([{ "mesh": 0 }]));
    let plain = level.import();
    let glb = level.glb();
    let json_len = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let (json, binary_chunk) = glb[20..].split_at(json_len);
    let build = |json: &[u8], before_binary: &[u8]| {
        let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
        bytes.extend((json.len() as u32).to_le_bytes());
        bytes.extend(b"JSON");
        bytes.extend(json);
        bytes.extend(before_binary);
        bytes.extend(binary_chunk);
        let len = bytes.len() as u32;
        bytes[8..12].copy_from_slice(&len.to_le_bytes());
        bytes
    };
    let padded = [json, b"\0\0\0\0"].concat();
    let marked = [b"\xEF\xBB\xBF", json, b" "].concat();
    let other = [&4u32.to_le_bytes()[..], b"ACME", b"data"].concat();
    for bytes in [build(&padded, &[]), build(&marked, &[]), build(json, &other)] {
        assert_eq!(import(&bytes).expect("a valid level").map.hash(), plain.map.hash());
    }
    let text = gltf_level(json!([{ "mesh": 0 }])).to_string();
    let marked = [b"\xEF\xBB\xBF", text.as_bytes(), b"\n"].concat();
    assert_eq!(
        import(&marked).expect("a valid level").map.hash(),
        gltf(&serde_json::from_str(&text).unwrap()).unwrap().map.hash()
    );
}

/// Files in memory.
struct Folder(BTreeMap<&'static str, Vec<u8>>);

impl Files for Folder {
    fn read(&self, path: &str) -> Result<Vec<u8>, String> {
        self.0.get(path).cloned().ok_or_else(|| "there is no such file".to_owned())
    }
}

#[test]
fn buffers_are_read_from_files_beside_the_level_and_from_archives() {
    let level = Level::new(json!([{ "mesh": 0 }, { "mesh": 0, "translation": [30, 2, 0] }]));
    let plain = level.import();
    let text = |uri: &str| {
        let mut json = level.json.clone();
        json["buffers"] = json!([{ "byteLength": level.binary.len(), "uri": uri }]);
        json.to_string().into_bytes()
    };
    let folder = Folder(BTreeMap::from([("my level.bin", level.binary.clone())]));
    let read = |bytes: &[u8], files: &dyn Files| surefoot_levels::import_gltf(bytes, None, &PLAIN, files);
    let beside = read(&text("my%20level.bin"), &folder).expect("a valid level");
    assert_eq!(beside.map.hash(), plain.map.hash());
    for (uri, files, expected) in [
        ("other.bin", &folder as &dyn Files, "`other.bin`, which cannot be read: there is no such file"),
        ("my%20level.bin", &NoFiles, "send a .zip of the level and its files"),
        ("https://example.com/level.bin", &folder, "not in a network"),
    ] {
        let error = refusal(read(&text(uri), files), expected);
        assert!(error.contains(expected), "`{expected}` is not in `{error}`");
    }

    let archive = |files: &[(&str, &[u8])]| {
        let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        for (name, content) in files {
            writer.start_file(*name, zip::write::SimpleFileOptions::default()).expect("a new file");
            writer.write_all(content).expect("memory takes all bytes");
        }
        writer.finish().expect("memory takes all bytes").into_inner()
    };
    let (gltf, sidecar) = (text("../data/my%20level.bin"), br#"{"leave_out": ["nothing"]}"#);
    let whole = archive(&[
        ("hall/level.gltf", &gltf),
        ("data/my level.bin", &level.binary),
        ("hall/level.surefoot.json", sidecar),
    ]);
    let unpacked = surefoot_levels::import_zip(&whole, None, &PLAIN).expect("a valid level");
    assert_eq!(unpacked.map.hash(), plain.map.hash());
    assert_eq!(surefoot_levels::unpacked_bytes(&whole), Ok((gltf.len() + level.binary.len() + sidecar.len()) as u64));
    for (files, expected) in [
        (&[("level.gltf", &gltf[..])][..], "it is outside the .zip"),
        (&[("a.obj", &b"v 0 0 0"[..]), ("b.obj", b"v 0 0 0")][..], "several levels, such as `a.obj` and `b.obj`"),
        (&[("readme.txt", &b"hello"[..])][..], "no .gltf, .glb or .obj"),
    ] {
        let error = refusal(surefoot_levels::import_zip(&archive(files), None, &PLAIN), expected);
        assert!(error.contains(expected), "`{expected}` is not in `{error}`");
    }
    let damaged = whole[..whole.len() / 2].to_vec();
    assert!(refusal(surefoot_levels::import_zip(&damaged, None, &PLAIN), "zip").contains("the .zip cannot be read"));
}

#[test]
fn levels_far_from_their_origin_keep_their_millimetres_and_say_where_it_is() {
    let boxes = |x: f64, y: f64, z: f64| {
        let nodes = (0..6).map(|idx| {
            let idx = f64::from(idx);
            json!({ "mesh": 0, "translation": [x + 0.3 * idx, y + 0.1 * idx, z + 20.0 * idx] })
        });
        Level::new(nodes.collect()).import()
    };
    let near = boxes(0.0, 0.0, 0.0);
    let far = boxes(3_133_805.225_747_891, 316.75, -4_659_713.478_714_659);
    assert_same(&near, &far);
    let expected = near.map.frame().origin - glam::DVec3::new(3_133_805.225_747_891, 316.75, -4_659_713.478_714_659);
    assert!((far.map.frame().origin - expected).length() < 1.0e-3, "{:?}", far.map.frame());

    let text = |x: f64| {
        let vertices = [[0.0, 0.0], [0.0, 20.125], [20.125, 20.125], [20.125, 0.0]];
        let lines = vertices.map(|[dx, dz]| format!("v {} 316.75 {}\n", x + dx, dz - x));
        format!("o floor\n{}f 1 2 3 4\n", lines.concat())
    };
    let read =
        |text: &str, options| surefoot_levels::import_obj(text.as_bytes(), None, &options).expect("a valid level");
    assert_same(&read(&text(0.0), PLAIN), &read(&text(5_400_123.5), PLAIN));

    // In centimetres with z up, the frame leads back to the level's own coordinates.
    let options = ImportOptions { scale: 0.01, up: UpAxis::Z, ..PLAIN };
    let level =
        read("o wall\nv 61234500 0 0\nv 61236500 0 0\nv 61236500 0 2000\nv 61234500 0 2000\nf 1 2 3 4\n", options);
    let LevelFrame { scale, up, .. } = *level.map.frame();
    assert_eq!((scale, up), (0.01, UpAxis::Z));
    let corner = corners(&level.map)[0][0];
    let back = level.map.frame().to_level(corner);
    assert!((back - glam::DVec3::new(61_234_500.0, 0.0, 0.0)).length() < 0.1, "{back}");
    let saved = surefoot_levels::decode(&surefoot_levels::encode(&level.map)).expect("just written");
    assert_eq!(saved.frame(), level.map.frame());
    assert!((saved.frame().to_map(back) - corner).length() < 1.0e-3, "{}", Vec3::ZERO);
}
