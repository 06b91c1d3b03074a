//! Lets the program, tests, benches and examples find Embree's library at run time.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Set by `embree4-sys` where the library is outside the loader's default folders.
    if let Some(lib) = std::env::var_os("DEP_EMBREE4_LIB") {
        println!("cargo::rustc-link-arg=-Wl,-rpath,{}", lib.display());
    }
}
