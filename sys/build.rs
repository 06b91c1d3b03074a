//! Finds Embree 4, generates bindings from its header, and says how to link and load it.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

const NOT_FOUND: &str = "Embree 4 was not found. Run `make setup` (scripts/setup.sh) in the \
    checkout, or set EMBREE_DIR to a folder that has include/embree4 and lib in it, or build bdpm \
    without it: --no-default-features";

/// Embree 4.3.0: its hits are larger than those of before, at the same major version.
const OLDEST: u32 = 40_300;

/// An Embree installation.
struct Install {
    include: PathBuf,
    lib: PathBuf,
    /// Whether compiler, linker and loader look there by themselves.
    is_default: bool,
}

impl Install {
    fn below(prefix: &Path) -> Option<Self> {
        let include = prefix.join("include");
        if !include.join("embree4/rtcore.h").exists() {
            return None;
        }
        let arch = env::var("CARGO_CFG_TARGET_ARCH").unwrap();
        let lib = [format!("lib/{arch}-linux-gnu"), "lib64".into(), "lib".into()]
            .iter()
            .map(|folder| prefix.join(folder))
            .find(|folder| {
                ["libembree4.so", "libembree4.dylib", "embree4.lib"]
                    .iter()
                    .any(|name| folder.join(name).exists())
            })?;
        Some(Self { include, lib, is_default: prefix == Path::new("/usr") })
    }

    /// Refuses headers that these bindings do not know.
    fn check_version(&self) -> Result<(), String> {
        let path = self.include.join("embree4/rtcore_config.h");
        println!("cargo::rerun-if-changed={}", path.display());
        let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let version = text
            .lines()
            .find_map(|line| line.trim().strip_prefix("#define RTC_VERSION "))
            .and_then(|number| number.trim().parse::<u32>().ok())
            .ok_or_else(|| format!("{}: it has no `#define RTC_VERSION`", path.display()))?;
        if (OLDEST..50_000).contains(&version) {
            return Ok(());
        }
        let (major, minor, patch) = (version / 10_000, version / 100 % 100, version % 100);
        Err(format!(
            "{}: this is Embree {major}.{minor}.{patch}, but 4.3 or a newer 4 is needed; set \
             EMBREE_DIR to the folder of one",
            path.display()
        ))
    }
}

fn main() {
    println!("cargo::rerun-if-env-changed=EMBREE_DIR");
    println!("cargo::rerun-if-env-changed=DOCS_RS");
    println!("cargo::rerun-if-changed=wrapper.h");
    println!("cargo::rustc-check-cfg=cfg(docs_without_embree)");

    let Some(install) = find() else {
        if let Some(dir) = embree_dir() {
            println!(
                "cargo::error=EMBREE_DIR is {}: no include/embree4 and lib there",
                dir.display()
            );
        } else if env::var_os("DOCS_RS").is_some() {
            // No header, no declarations: what is documented is the crate's own text.
            println!("cargo::rustc-cfg=docs_without_embree");
        } else {
            println!("cargo::error={NOT_FOUND}");
        }
        return;
    };
    if let Err(error) = install.check_version() {
        println!("cargo::error={error}");
        return;
    }
    generate(&install);

    let lib = install.lib.display();
    println!("cargo::rerun-if-changed={lib}");
    // For programs that `cargo install` copies away from the library.
    println!("cargo::rustc-env=EMBREE4_SYS_LIB={lib}");
    if env::var_os("CARGO_FEATURE_LINK").is_none() {
        if !install.is_default {
            link_beside_programs(&install.lib);
            link_for_doc_tests(&install.lib);
        }
        return;
    }
    println!("cargo::rustc-link-lib=dylib=embree4");
    if install.is_default {
        return;
    }
    println!("cargo::rustc-link-search=native={lib}");
    for arg in ["-Xlinker", "-rpath", "-Xlinker", &lib.to_string()] {
        println!("cargo::rustc-link-arg={arg}"); // this package's own tests
    }
    println!("cargo::metadata=lib={lib}"); // DEP_EMBREE4_LIB for the dependent's build script
    link_for_doc_tests(&install.lib);
}

/// The folder that the user names; absolute, as its libraries are looked up at run time.
fn embree_dir() -> Option<PathBuf> {
    let dir = env::var_os("EMBREE_DIR").filter(|dir| !dir.is_empty())?;
    Some(fs::canonicalize(&dir).unwrap_or(dir.into()))
}

fn find() -> Option<Install> {
    if let Some(dir) = embree_dir() {
        // A user's word is final: falling back would build against another Embree than was asked.
        return Install::below(&dir);
    }
    // At run time: a moved checkout keeps its compiled build script.
    let package = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR")?);
    let out = PathBuf::from(env::var_os("OUT_DIR")?);
    // Beside this package in the checkout; or beside the outermost target folder, where a dependent
    // project may have one, and in which `cargo package` unpacks this one to verify it. No folder
    // above that is searched: programs load the library that is found here.
    let is_target = |folder: &&Path| folder.file_name() == Some(OsStr::new("target"));
    let project = out.ancestors().filter(is_target).last().and_then(Path::parent);
    let folders = package.parent().into_iter().chain(project);
    let prefixes = folders.map(|folder| folder.join(".embree"));
    prefixes.chain(["/usr/local".into(), "/usr".into()]).find_map(|prefix| Install::below(&prefix))
}

fn generate(install: &Install) {
    let bindings = bindgen::builder()
        .header("wrapper.h")
        .clang_arg(format!("-I{}", install.include.display()))
        .allowlist_item("(rtc|RTC).*")
        // An enum of Rust's holding a value that only a newer library knows is undefined behavior.
        .default_enum_style(bindgen::EnumVariation::NewType {
            is_bitfield: false,
            is_global: false,
        })
        .bitfield_enum("RTC.*Flags")
        .prepend_enum_name(false)
        .derive_default(true)
        .generate_comments(false)
        .rust_target(bindgen::RustTarget::stable(88, 0).expect("a version that bindgen knows"))
        .rust_edition(bindgen::RustEdition::Edition2024)
        .parse_callbacks(Box::new(bindgen::CargoCallbacks::new()))
        .generate();
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap()).join("bindings.rs");
    match bindings {
        Ok(bindings) => {
            let mut text = bindings.to_string();
            if env::var_os("CARGO_FEATURE_LINK").is_none() {
                text = load_at_run_time(&text);
            }
            fs::write(out, text).expect("OUT_DIR is writable");
        }
        Err(error) => println!(
            "cargo::error=bindgen cannot read {}: {error}",
            install.include.join("embree4/rtcore.h").display()
        ),
    }
}

/// Replaces the declarations of foreign functions by a table that is filled when the library is
/// loaded, and by functions of the same names that call it.
fn load_at_run_time(bindings: &str) -> String {
    let mut file = syn::parse_file(bindings).expect("bindgen writes Rust");
    let mut functions = Vec::new();
    file.items.retain_mut(|item| {
        let syn::Item::ForeignMod(foreign) = item else { return true };
        for item in &foreign.items {
            match item {
                syn::ForeignItem::Fn(function) => functions.push(function.sig.clone()),
                _ => panic!("Embree has functions only"),
            }
        }
        false
    });
    let (mut fields, mut loads, mut calls) = (Vec::new(), Vec::new(), Vec::new());
    for signature in &functions {
        let syn::Signature { ident: name, inputs, output, .. } = signature;
        let arguments: Vec<_> = inputs
            .iter()
            .map(|input| match input {
                syn::FnArg::Typed(typed) => &typed.pat,
                syn::FnArg::Receiver(_) => panic!("functions of C have no receiver"),
            })
            .collect();
        let symbol = format!("{name}\0");
        fields.push(quote::quote! { pub #name: unsafe extern "C" fn(#inputs) #output });
        loads.push(quote::quote! { #name: unsafe { *library.get(#symbol.as_bytes())? } });
        calls.push(quote::quote! {
            #[inline]
            pub unsafe fn #name(#inputs) #output {
                unsafe { (crate::library::functions().#name)(#(#arguments),*) }
            }
        });
    }
    let table = quote::quote! {
        pub struct Functions {
            #(#fields,)*
            _library: ::libloading::Library,
        }
        impl Functions {
            pub unsafe fn of(
                library: ::libloading::Library,
            ) -> ::std::result::Result<Self, ::libloading::Error> {
                Ok(Self { #(#loads,)* _library: library })
            }
        }
        #(#calls)*
    };
    let types = quote::ToTokens::to_token_stream(&file);
    format!("{types}\n{table}")
}

/// Links to the libraries in Cargo's folder of programs, where the loader looks first. A program of
/// any package that depends on this one is built there.
fn link_beside_programs(lib: &Path) {
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap());
    // target/PROFILE/build/PACKAGE-HASH/out
    if let Some(profile) = out.ancestors().nth(3) {
        link_libraries(lib, profile);
    }
}

/// Doc tests run in a folder of the system and get no link arguments, thus no rpath. But Cargo puts
/// search paths below its target folder on their library path, so links to the libraries go there.
fn link_for_doc_tests(lib: &Path) {
    let folder = PathBuf::from(env::var_os("OUT_DIR").unwrap()).join("lib");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("OUT_DIR is writable");
    link_libraries(lib, &folder);
    println!("cargo::rustc-link-search=native={}", folder.display());
}

/// Makes links in `folder` to the libraries of Embree in `lib`.
fn link_libraries(lib: &Path, folder: &Path) {
    for entry in fs::read_dir(lib).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let text = name.to_string_lossy();
        if text.starts_with("libembree4") || text.starts_with("libtbb") {
            let link = folder.join(&name);
            let _ = fs::remove_file(&link);
            #[cfg(unix)]
            std::os::unix::fs::symlink(entry.path(), link).expect("the folder is writable");
        }
    }
}
