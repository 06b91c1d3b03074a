//! Lets the extension find Embree's library where it was built. A wheel carries the library
//! (scripts/wheel.sh).

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if let Some(lib) = std::env::var_os("DEP_EMBREE4_LIB") {
        for arg in ["-Xlinker", "-rpath", "-Xlinker", &lib.to_string_lossy()] {
            println!("cargo::rustc-link-arg={arg}");
        }
    }
}
