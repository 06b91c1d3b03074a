//! Settings of a device.

use std::ffi::CString;
use std::fmt::Write;
use std::num::NonZero;

/// Settings of a [`Device`](super::Device); the default is Embree's choice.
///
/// Embree reads its settings from a text. Others than these affect memory safety (block sizes,
/// builders for other data, floating-point traps), so they cannot be set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeviceConfig {
    /// Vector instructions; by default the best that the processor has.
    pub isa: Option<Isa>,
    /// Threads that build scenes, at most the number of hardware threads, which is the default.
    pub threads: Option<NonZero<u16>>,
}

/// Vector instruction sets that Embree is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// 4 floats wide; every processor of 64 bits from Intel and AMD has them.
    Sse2,
    /// 4 floats wide.
    Sse42,
    /// 8 floats wide.
    Avx,
    /// 8 floats wide.
    Avx2,
    /// 16 floats wide.
    Avx512,
}

impl DeviceConfig {
    /// The settings in Embree's syntax.
    pub(super) fn text(self) -> CString {
        let mut text = String::new();
        if let Some(isa) = self.isa {
            let name = match isa {
                Isa::Sse2 => "sse2",
                Isa::Sse42 => "sse42",
                Isa::Avx => "avx",
                Isa::Avx2 => "avx2",
                Isa::Avx512 => "avx512",
            };
            write!(text, "isa={name},").expect("strings take all text");
        }
        if let Some(threads) = self.threads {
            write!(text, "threads={threads}").expect("strings take all text");
        }
        CString::new(text).expect("no zero byte in it")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_in_embrees_words() {
        let text = |isa, threads| {
            let config = DeviceConfig { isa, threads: NonZero::new(threads) };
            config.text().into_string().unwrap()
        };
        assert_eq!(text(None, 0), "");
        assert_eq!(text(Some(Isa::Avx2), 1), "isa=avx2,threads=1");
        assert_eq!(text(Some(Isa::Sse42), 0), "isa=sse42,");
        assert_eq!(text(None, 65_535), "threads=65535");
    }
}
