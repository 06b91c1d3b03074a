//! The bindings that bindgen generates from the header, and assertions about any header.

/// Generated code in the style of C.
#[allow(non_camel_case_types, non_snake_case, non_upper_case_globals, missing_docs)]
#[allow(clippy::all, clippy::undocumented_unsafe_blocks, unsafe_op_in_unsafe_fn)]
mod generated {
    include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
}

pub use generated::*;

// bindgen asserts every size and offset that libclang computed. These are about the header itself:
// the versions that we know, and the alignments that Embree's vector instructions fault without.
const _: () = {
    assert!(RTC_VERSION_MAJOR == 4, "only Embree 4 is supported");
    assert!(RTC_VERSION >= 40_300, "hits are larger from Embree 4.3.0 on");
    assert!(align_of::<RTCRay>() == 16 && size_of::<RTCRay>() == 48);
    assert!(align_of::<RTCRayHit>() == 16 && align_of::<RTCRayHit4>() == 16);
    assert!(align_of::<RTCRayHit8>() == 32 && align_of::<RTCRay8>() == 32);
    assert!(align_of::<RTCRayHit16>() == 64 && align_of::<RTCRay16>() == 64);
    // The struct of arrays has no padding before its last field, whatever the header's options.
    assert!(size_of::<RTCRay4>() == 12 * 4 * 4 && size_of::<RTCRay16>() == 12 * 16 * 4);
    let hit_words = 7 + size_of::<[u32; RTC_MAX_INSTANCE_LEVEL_COUNT as usize]>() / 4;
    assert!(size_of::<RTCRayHit16>() >= (12 + hit_words) * 16 * 4);
};
