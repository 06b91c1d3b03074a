//! Lets the program, tests, benches and examples find Embree's library at run time.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Set by `embree4-sys` where the library is outside the loader's default folders.
    if let Some(lib) = std::env::var_os("DEP_EMBREE4_LIB") {
        // Not -Wl, which would split a path at its commas.
        for arg in ["-Xlinker", "-rpath", "-Xlinker", &lib.to_string_lossy()] {
            println!("cargo::rustc-link-arg={arg}");
        }
    }
}
