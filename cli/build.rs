//! Leaves symbols out of the programs: cargo ignores the profile's `strip` for packages with an override of their own.
//! SUREFOOT_SYMBOLS=1 keeps them, for backtraces with names.

fn main() {
    println!("cargo::rerun-if-changed=Cargo.toml");
    println!("cargo::rerun-if-env-changed=SUREFOOT_SYMBOLS");
    let is_msvc = std::env::var("CARGO_CFG_TARGET_ENV").is_ok_and(|it| it == "msvc");
    let is_debug = std::env::var("PROFILE").is_ok_and(|it| it == "debug");
    if !is_msvc && !is_debug && std::env::var_os("SUREFOOT_SYMBOLS").is_none() {
        println!("cargo::rustc-link-arg-bins=-Wl,-s");
    }
}
