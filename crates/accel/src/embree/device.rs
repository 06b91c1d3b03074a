//! The device: Embree's context, its errors and its memory count.

use super::scene::SceneBuilder;
use super::{DeviceConfig, EmbreeError, guard};
use crate::shared_library;
use embree4_sys as sys;
use std::ffi::{CStr, c_char, c_void};
use std::path::Path;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::ThreadId;

/// An Embree device; cloning it is cheap and shares it. Scenes keep what they need of it alive.
#[derive(Clone, Debug)]
pub struct Device {
    inner: Arc<DeviceInner>,
}

/// Field order does not matter for soundness: `drop` releases the handle while the sink lives.
#[derive(Debug)]
struct DeviceInner {
    handle: sys::RTCDevice,
    /// Boxed, because Embree holds its address.
    sink: Box<ErrorSink>,
}

// SAFETY: Embree's API functions may be called on one device from any thread (its error code is
// kept per thread, its reference count is atomic), and `ErrorSink` is `Sync` by its own types.
unsafe impl Send for DeviceInner {}
// SAFETY: as above; nothing here gives out `&mut` to what the handle points to.
unsafe impl Sync for DeviceInner {}

impl Drop for DeviceInner {
    fn drop(&mut self) {
        // SAFETY: the handle came from `rtcNewDevice` and is released once. Every scene holds an
        // `Arc` of this struct and releases its own handle first, so this is the last reference
        // and no callback can fire after it; the sink drops after this function.
        unsafe { sys::rtcReleaseDevice(self.handle) };
    }
}

/// Where Embree's callbacks write.
#[derive(Debug, Default)]
struct ErrorSink {
    /// Messages with the thread that caused them, oldest first.
    messages: Mutex<Vec<(ThreadId, String)>>,
    /// Bytes that Embree holds now.
    bytes: AtomicI64,
}

impl ErrorSink {
    /// Bound of the list: messages of Embree's worker threads are never read.
    const MAX_MESSAGES: usize = 64;

    fn push(&self, message: String) {
        let mut messages = self.messages.lock().unwrap_or_else(PoisonError::into_inner);
        if messages.len() >= Self::MAX_MESSAGES {
            messages.remove(0);
        }
        messages.push((std::thread::current().id(), message));
    }

    /// Removes this thread's messages and returns the last.
    fn take(&self) -> Option<String> {
        let mut messages = self.messages.lock().unwrap_or_else(PoisonError::into_inner);
        let me = std::thread::current().id();
        let last = messages.iter().rev().find(|(thread, _)| *thread == me).map(|m| m.1.clone());
        messages.retain(|(thread, _)| *thread != me);
        last
    }
}

unsafe extern "C" fn on_error(sink: *mut c_void, _code: sys::RTCError, text: *const c_char) {
    // A panic must not cross into C++.
    let _ = std::panic::catch_unwind(|| {
        // SAFETY: `sink` is the address that `Device` registered, of a boxed `ErrorSink` that
        // outlives the device handle and is only used through `&`.
        let sink = unsafe { &*sink.cast::<ErrorSink>() };
        let message = if text.is_null() {
            String::new()
        } else {
            // SAFETY: Embree passes a text that ends in a zero byte and lives during this call.
            unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
        };
        sink.push(message);
    });
}

unsafe extern "C" fn on_memory(sink: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: as in `on_error`.
    let sink = unsafe { &*sink.cast::<ErrorSink>() };
    sink.bytes.fetch_add(bytes as i64, Ordering::Relaxed);
    true // go on; false would cancel the allocation
}

impl Device {
    /// A device with Embree's defaults: the best instruction set, all cores for builds.
    ///
    /// # Errors
    /// If Embree does not run on this processor, or the library does not fit the header of the
    /// build: by its version, or by the address where it writes a hit.
    pub fn new() -> Result<Self, EmbreeError> {
        Self::with_config(DeviceConfig::default())
    }

    /// A device with settings.
    ///
    /// # Errors
    /// As [`Device::new`], and if the processor lacks the instructions that are asked for.
    pub fn with_config(config: DeviceConfig) -> Result<Self, EmbreeError> {
        let check = |file: &Path| shared_library::check(file, &["libembree4", "libtbb"]);
        sys::load_checked(check)
            .map_err(|error| EmbreeError::Load { problem: error.to_string() })?;
        let text = config.text();
        // SAFETY: null asks for this thread's error without a device; reading clears a stale one.
        unsafe { sys::rtcGetDeviceError(std::ptr::null_mut()) };
        // SAFETY: `text` ends in a zero byte and outlives the call; Embree copies what it needs.
        let handle = unsafe { sys::rtcNewDevice(text.as_ptr()) };
        if handle.is_null() {
            // SAFETY: as above.
            let code = unsafe { sys::rtcGetDeviceError(std::ptr::null_mut()) };
            let message = "rtcNewDevice returned nothing".into();
            return Err(library_error("make a device", code, message));
        }
        let device = Self { inner: Arc::new(DeviceInner { handle, sink: Box::default() }) };
        let sink = (&raw const *device.inner.sink).cast_mut().cast::<c_void>();
        // SAFETY: the handle is valid. `sink` points to an `ErrorSink` on the heap that is neither
        // moved nor freed before the handle is released (see `DeviceInner::drop`), and both
        // callbacks use it through `&` only, which `ErrorSink: Sync` allows from every thread.
        unsafe {
            sys::rtcSetDeviceErrorFunction(handle, Some(on_error), sink);
            sys::rtcSetDeviceMemoryMonitorFunction(handle, Some(on_memory), sink);
        }
        device.check_version()?;
        device.check_features()?;
        guard::check(&device)?;
        Ok(device)
    }

    /// An empty scene to add meshes to.
    ///
    /// # Errors
    /// If Embree cannot make one.
    pub fn scene_builder(&self) -> Result<SceneBuilder, EmbreeError> {
        SceneBuilder::new(self)
    }

    /// Version of the library that was loaded, as `4.4.0`.
    pub fn version(&self) -> String {
        version_text(self.property(sys::RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION))
    }

    /// Size of the widest ray packet that this device traces as one: 16, 8, 4, or 1 for none.
    pub fn native_packet_size(&self) -> usize {
        use sys::RTCDeviceProperty as Property;
        [
            (16, Property::RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED),
            (8, Property::RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED),
            (4, Property::RTC_DEVICE_PROPERTY_NATIVE_RAY4_SUPPORTED),
        ]
        .into_iter()
        .find(|&(_, property)| self.property(property) != 0)
        .map_or(1, |(size, _)| size)
    }

    /// Bytes of this device's scenes and buffers, by Embree's own count.
    pub fn bytes(&self) -> usize {
        usize::try_from(self.inner.sink.bytes.load(Ordering::Relaxed)).unwrap_or(0)
    }

    pub(super) fn handle(&self) -> sys::RTCDevice {
        self.inner.handle
    }

    /// Runs a set-up call and turns an error that it raised on this thread into `Err`.
    pub(super) fn checked<T>(
        &self,
        doing: &'static str,
        call: impl FnOnce() -> T,
    ) -> Result<T, EmbreeError> {
        // The error code stays until it is read: clear an older one, which is not of this call.
        self.take_error(doing).ok();
        let value = call();
        self.take_error(doing)?;
        Ok(value)
    }

    /// Like [`checked`](Self::checked), for calls that return a new object.
    pub(super) fn made<T>(
        &self,
        doing: &'static str,
        call: impl FnOnce() -> *mut T,
    ) -> Result<NonNull<T>, EmbreeError> {
        let nothing = || {
            let message = "nothing was returned".into();
            library_error(doing, sys::RTCError::RTC_ERROR_NONE, message)
        };
        NonNull::new(self.checked(doing, call)?).ok_or_else(nothing)
    }

    fn take_error(&self, doing: &'static str) -> Result<(), EmbreeError> {
        // SAFETY: the handle is valid as long as `self`; the code belongs to this thread.
        let code = unsafe { sys::rtcGetDeviceError(self.inner.handle) };
        let message = self.inner.sink.take();
        if code == sys::RTCError::RTC_ERROR_NONE {
            return Ok(());
        }
        Err(library_error(doing, code, message.unwrap_or_default()))
    }

    fn property(&self, property: sys::RTCDeviceProperty) -> isize {
        // SAFETY: the handle is valid as long as `self`.
        unsafe { sys::rtcGetDeviceProperty(self.inner.handle, property) }
    }

    fn check_version(&self) -> Result<(), EmbreeError> {
        let library = self.property(sys::RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION);
        let header = sys::RTC_VERSION as isize;
        if fits(library, header) {
            return Ok(());
        }
        Err(EmbreeError::Version { library: version_text(library), header: version_text(header) })
    }

    /// Refuses builds of Embree that would miss triangles that other backends hit.
    fn check_features(&self) -> Result<(), EmbreeError> {
        use sys::RTCDeviceProperty as Property;
        if self.property(Property::RTC_DEVICE_PROPERTY_TRIANGLE_GEOMETRY_SUPPORTED) == 0 {
            return Err(EmbreeError::Feature("without triangles"));
        }
        if self.property(Property::RTC_DEVICE_PROPERTY_BACKFACE_CULLING_ENABLED) != 0 {
            return Err(EmbreeError::Feature("to hide the back sides of triangles"));
        }
        Ok(())
    }
}

/// An older library lacks functions of the header, and another major version gives them other
/// meanings. The version does not show whether a newer library writes to the addresses of this
/// header: `guard` tests it.
fn fits(library: isize, header: isize) -> bool {
    library / 10_000 == header / 10_000 && library >= header
}

fn version_text(version: isize) -> String {
    format!("{}.{}.{}", version / 10_000, version / 100 % 100, version % 100)
}

fn library_error(doing: &'static str, code: sys::RTCError, message: String) -> EmbreeError {
    let code = match code {
        sys::RTCError::RTC_ERROR_NONE => "no error code",
        sys::RTCError::RTC_ERROR_INVALID_ARGUMENT => "invalid argument",
        sys::RTCError::RTC_ERROR_INVALID_OPERATION => "invalid operation",
        sys::RTCError::RTC_ERROR_OUT_OF_MEMORY => "out of memory",
        sys::RTCError::RTC_ERROR_UNSUPPORTED_CPU => "unsupported processor",
        sys::RTCError::RTC_ERROR_CANCELLED => "canceled",
        _ => "unknown error",
    };
    EmbreeError::Library { doing, code, message }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Raises an error as Embree's own code does: with a code on this thread and a callback.
    fn misuse(device: &Device) {
        let kind = sys::RTCGeometryType(9999);
        // SAFETY: a valid device; Embree checks the kind of geometry and reports an unknown one.
        assert!(unsafe { sys::rtcNewGeometry(device.handle(), kind) }.is_null());
    }

    fn sink(device: &Device) -> *mut c_void {
        (&raw const *device.inner.sink).cast_mut().cast()
    }

    #[test]
    fn an_error_becomes_err_with_embrees_words() {
        let device = Device::new().unwrap();
        let error = device.checked("make nonsense", || misuse(&device)).unwrap_err();
        let EmbreeError::Library { doing, code, message } = &error else { panic!("{error}") };
        assert_eq!(*doing, "make nonsense");
        assert_ne!(*code, "no error code");
        assert!(!message.is_empty(), "{error}");
        assert_eq!(device.inner.sink.take(), None, "the message was consumed");
    }

    #[test]
    fn a_stale_error_is_not_blamed_on_a_good_call() {
        let device = Device::new().unwrap();
        misuse(&device);
        assert_eq!(device.checked("do nothing", || 7), Ok(7));
    }

    #[test]
    fn another_threads_error_is_not_blamed_on_this_one() {
        let device = Device::new().unwrap();
        let result = device.checked("do nothing here", || {
            std::thread::scope(|threads| threads.spawn(|| misuse(&device)).join().unwrap());
        });
        assert_eq!(result, Ok(()));
    }

    #[test]
    fn the_callback_takes_null_text_and_many_messages() {
        let device = Device::new().unwrap();
        for _ in 0..3 * ErrorSink::MAX_MESSAGES {
            // SAFETY: the sink of a live device; null text is allowed.
            unsafe { on_error(sink(&device), sys::RTCError(1), std::ptr::null()) };
        }
        assert_eq!(device.inner.sink.messages.lock().unwrap().len(), ErrorSink::MAX_MESSAGES);
        assert_eq!(device.inner.sink.take(), Some(String::new()));
    }

    #[test]
    fn versions_fit_when_the_library_is_the_same_or_newer() {
        assert!(fits(40_303, 40_303) && fits(40_400, 40_303));
        assert!(!fits(40_302, 40_303) && !fits(50_000, 40_303) && !fits(31_300, 40_303));
        assert_eq!(version_text(40_400), "4.4.0");
        assert!(fits(
            Device::new().unwrap().property(sys::RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION),
            sys::RTC_VERSION as isize
        ));
    }

    #[test]
    fn what_is_not_made_is_an_error() {
        let device = Device::new().unwrap();
        let error = device.made("make nothing", std::ptr::null_mut::<u8>).unwrap_err();
        let text = "Embree failed to make nothing: no error code (nothing was returned)";
        assert_eq!(error.to_string(), text);
    }

    #[test]
    fn the_instruction_set_is_the_one_asked_for() {
        use super::super::Isa;
        let with = |isa| Device::with_config(DeviceConfig { isa: Some(isa), threads: None });
        assert_eq!(with(Isa::Sse2).unwrap().native_packet_size(), 4);
        let avx512 = with(Isa::Avx512);
        if Device::new().unwrap().native_packet_size() == 16 {
            assert_eq!(avx512.unwrap().native_packet_size(), 16);
        } else {
            assert!(avx512.map_or(true, |device| device.native_packet_size() < 16));
        }
    }
}
