//! The header says what the library is: functions, structs, constants and the list of symbols are those of the Rust
//! source.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::mem::offset_of;
use std::path::{Path, PathBuf};
use std::process::Command;
use surefoot::abi;

fn folder() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: impl AsRef<Path>) -> String {
    std::fs::read_to_string(folder().join(path)).expect("a file of this crate")
}

/// The header without comments.
fn header() -> String {
    let text = read("include/surefoot.h");
    let mut parts = text.split("/*");
    let first = parts.next().expect("a text").to_owned();
    parts.fold(first, |code, part| code + part.split_once("*/").expect("the end of a comment").1)
}

fn squeezed(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The functions that the header declares: name to parameters and result.
fn declared() -> BTreeMap<String, String> {
    let code = header();
    let statements = code.split(';').map(squeezed).filter(|statement| statement.ends_with(')'));
    statements
        .filter(|statement| !statement.starts_with("typedef"))
        .map(|statement| {
            let (before, arguments) = statement.split_once('(').expect("arguments");
            let before = before.rsplit(['{', '}', '"']).next().expect("a declaration").trim();
            let (result, name) = before.rsplit_once(' ').expect("a result and a name");
            (name.to_owned(), format!("{result} ({arguments}"))
        })
        .collect()
}

/// The functions that the Rust source exports, in the words of C.
fn exported() -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    for file in ["mod", "agents", "graphs", "followers", "worlds"] {
        let source = read(format!("src/exports/{file}.rs"));
        for part in source.split("\n    fn sf_").skip(1) {
            let (name, rest) = part.split_once('(').expect("arguments");
            let (arguments, _) = rest.split_once(") {").expect("a body");
            let arguments = squeezed(arguments);
            let mut list: Vec<String> = arguments.trim_end_matches(',').split(", ").map(argument_in_c).collect();
            list.push("sf_error* error".to_owned());
            found.insert(format!("sf_{name}"), format!("sf_status ({})", list.join(", ")));
        }
        for part in source.split("destroy!(").skip(1) {
            let (list, _) = part.split_once(");").expect("an end");
            for entry in list.split(", ") {
                let (name, kind) = entry.split_once(' ').expect("a name and a type");
                let kind = name_in_c(kind);
                found.insert(name.to_owned(), format!("void ({kind}* {})", &kind["sf_".len()..]));
            }
        }
    }
    found.insert("sf_version".to_owned(), "const char* (void)".to_owned());
    found.insert("sf_abi_version".to_owned(), "uint32_t (void)".to_owned());
    found
}

fn argument_in_c(argument: &str) -> String {
    let (name, kind) = argument.split_once(": ").expect("a name and a type");
    // C marks constants behind each star, Rust before.
    let (kind, stars) = match kind {
        _ if kind.starts_with("*mut *mut ") => (name_in_c(&kind["*mut *mut ".len()..]), "**"),
        _ if kind.starts_with("*mut ") => (name_in_c(&kind["*mut ".len()..]), "*"),
        _ if kind.starts_with("*const ") => ("const ".to_owned() + &name_in_c(&kind["*const ".len()..]), "*"),
        _ => (name_in_c(kind), ""),
    };
    format!("{kind}{stars} {name}")
}

fn name_in_c(kind: &str) -> String {
    let plain = kind.trim_start_matches("abi::").trim_start_matches("Handle<").trim_start_matches("Shared<");
    match plain.trim_end_matches('>') {
        "u32" => "uint32_t".to_owned(),
        "i32" => "int32_t".to_owned(),
        "u64" => "uint64_t".to_owned(),
        "f32" => "float".to_owned(),
        "usize" => "size_t".to_owned(),
        "c_char" => "char".to_owned(),
        "c_void" => "void".to_owned(),
        "Option<abi::CastRays" => "sf_cast_rays".to_owned(),
        name => {
            let mut text = "sf".to_owned();
            for letter in name.chars() {
                if letter.is_ascii_uppercase() {
                    text.push('_');
                }
                text.push(letter.to_ascii_lowercase());
            }
            text
        }
    }
}

#[test]
fn functions_are_those_of_the_source() {
    let (declared, exported) = (declared(), exported());
    let names = |functions: &BTreeMap<String, String>| functions.keys().cloned().collect::<BTreeSet<_>>();
    assert_eq!(names(&declared), names(&exported));
    for (name, signature) in &exported {
        assert_eq!(declared[name], *signature, "{name}");
    }
}

#[test]
fn the_list_of_symbols_is_that_of_the_header() {
    let listed: Vec<String> = read("symbols.txt").lines().map(str::to_owned).collect();
    assert_eq!(listed, declared().into_keys().collect::<Vec<_>>(), "symbols.txt");
}

/// Adds assertions that a struct has the same size and fields in C.
macro_rules! compare {
    ($into:ident, $name:literal, $kind:ident { $($field:ident $(. $inner:ident)?),* $(,)? }) => {
        let size = size_of::<abi::$kind>();
        writeln!($into, "_Static_assert(sizeof({}) == {size}, \"size of {}\");", $name, $name).unwrap();
        $(
            let offset = offset_of!(abi::$kind, $field);
            let field = stringify!($field);
            let place = format!("offsetof({}, {field})", $name);
            writeln!($into, "_Static_assert({place} == {offset}, \"{field} of {}\");", $name).unwrap();
        )*
        let fields = [$(stringify!($field)),*];
        assert_eq!(fields_in_header($name), fields, "fields of {}", $name);
    };
}

/// The fields of a struct in the header.
fn fields_in_header(name: &str) -> Vec<String> {
    let code = header();
    let (_, body) = code.split_once(&format!("typedef struct {name} {{")).expect("the struct");
    let (body, _) = body.split_once('}').expect("its end");
    let fields = body.split(';').map(str::trim).filter(|field| !field.is_empty());
    fields
        .map(|field| {
            let name = field.rsplit([' ', '*']).next().expect("a name");
            name.split('[').next().expect("a name").to_owned()
        })
        .collect()
}

#[test]
fn structs_and_constants_are_those_of_the_source() {
    let mut program = String::from("#include \"surefoot.h\"\n");
    compare!(program, "sf_error", Error { code, message });
    compare!(program, "sf_vec3", Vec3 { x, y, z });
    compare!(program, "sf_place", Place { x, y, z });
    compare!(program, "sf_frame", Frame { origin, scale, z_up });
    compare!(program, "sf_ray", Ray { origin, direction });
    compare!(program, "sf_hit", Hit { distance, body_distance, surface });
    compare!(program, "sf_action", Action { forward, strafe, turn, jump });
    compare!(program, "sf_block", Block { foot, width, depth, height, yaw });
    compare!(program, "sf_other", Other { feet, velocity });
    compare!(program, "sf_device", Device { kind, two_way, from, to });
    compare!(
        program,
        "sf_body",
        Body {
            struct_size,
            height,
            radius,
            forward_speed,
            side_speed_share,
            turn_speed,
            jump_speed,
            gravity,
            max_slope,
            step_height,
            ground_acceleration,
            air_acceleration,
            zip_line_speed,
            jetpack_acceleration,
            jetpack_climb_speed,
            extra_jumps,
            coyote_ticks,
            uses_zip_lines,
            uses_jetpacks,
            climb_speed,
            mantle_height,
            swim_speed,
            crouch_height,
            dash_speed,
            wall_run_seconds,
            slide_seconds,
            dive_seconds
        }
    );
    compare!(
        program,
        "sf_state",
        State { struct_size, flags, feet, velocity, yaw, breath_used, jetpack_seconds, other_count, others }
    );
    compare!(
        program,
        "sf_locomotion",
        Locomotion {
            struct_size,
            pace,
            phase,
            ability,
            stride,
            stride_phase,
            ticks,
            was_thrown,
            step_offset,
            feet_height,
            rise,
            was_grounded
        }
    );
    compare!(program, "sf_progress", Progress { struct_size, reached, best_distance, stalled_decisions, decisions });
    compare!(program, "sf_leg_key", LegKey { from, to });
    compare!(program, "sf_query", Query { struct_size, without, start, goal, caution, avoid_count, avoid });
    compare!(program, "sf_leg", Leg { waypoint, key, ability, seconds, chance, death_chance });
    compare!(
        program,
        "sf_plan",
        Plan { first_leg, leg_count, seconds, chance, arrival_chance, death_chance, no_path, leads_near }
    );
    compare!(program, "sf_edge", Edge { key, ability, is_open, seconds, chance, death_chance, cost });
    compare!(program, "sf_graph_info", GraphInfo { struct_size, vertex_count, edge_count, island_count });
    compare!(program, "sf_ability_info", AbilityInfo { struct_size, name, animation });
    compare!(program, "sf_edit", Edit { kind, value, from, to });
    compare!(program, "sf_traversal", Traversal { key, decisions, end });
    compare!(program, "sf_step", Step { struct_size, kind, waypoint, leg, leg_count, plans, stands });
    compare!(program, "sf_gait", Gait { struct_size, speed, acceleration, turn_rate, wall_distance, avoids_jumps });
    compare!(program, "sf_outcome", Outcome { reward, end });
    for (name, value) in [
        ("SF_ABI_VERSION", abi::ABI_VERSION as usize),
        ("SF_RAY_COUNT", abi::RAY_COUNT),
        ("SF_MAX_OTHERS", abi::MAX_OTHERS),
        ("SF_STOP_START", abi::STOP_START as usize),
        ("SF_STOP_GOAL", abi::STOP_GOAL as usize),
        ("SF_COORDINATES_MAP", abi::COORDINATES_MAP as usize),
        ("SF_COORDINATES_LEVEL", abi::COORDINATES_LEVEL as usize),
        ("SF_TICKS_PER_DECISION", surefoot_world::TICKS_PER_DECISION as usize),
        ("SF_TICKS_PER_SECOND", surefoot_world::TICKS_PER_SECOND as usize),
        ("SF_GROUNDED", abi::GROUNDED as usize),
        ("SF_CAN_JUMP", abi::CAN_JUMP as usize),
        ("SF_RIDES", abi::RIDES as usize),
        ("SF_SURFACE_JETPACK", abi::surface_number(surefoot_world::mesh::Surface::Jetpack) as usize),
        ("SF_JETPACK", surefoot_world::Ability::JETPACK.idx()),
        ("SF_CLIMB", surefoot_world::Ability::CLIMB.idx()),
        ("SF_MANTLE", surefoot_world::Ability::MANTLE.idx()),
        ("SF_SWIM", surefoot_world::Ability::SWIM.idx()),
        ("SF_CROUCH", surefoot_world::Ability::CROUCH.idx()),
        ("SF_DASH", surefoot_world::Ability::DASH.idx()),
        ("SF_WALL_RUN", surefoot_world::Ability::WALL_RUN.idx()),
        ("SF_SLIDE", surefoot_world::Ability::SLIDE.idx()),
        ("SF_DIVE", surefoot_world::Ability::DIVE.idx()),
        ("SF_OWN_MOVE", surefoot_world::Ability::own(0).idx()),
        ("SF_PACE_STOP", surefoot_world::Pace::Stop as usize),
        ("SF_ARRIVAL_RAY_COUNT", surefoot_world::arrival::LINE_COUNT),
        ("SF_RAY_RANGE", surefoot_world::sense::RAY_RANGE_M as usize),
    ] {
        writeln!(program, "_Static_assert({name} == {value}, \"{name}\");").unwrap();
    }
    compile(&program);
}

/// Compiles a C program as far as that its assertions hold.
fn compile(program: &str) {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("layout.c");
    std::fs::write(&path, program).expect("a folder for temporary files");
    let mut compiler = Command::new("cc");
    compiler.args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-I"]);
    let output = compiler.arg(folder().join("include")).arg(&path).output().expect("a C compiler");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
