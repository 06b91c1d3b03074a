//! Intel Open Image Denoise 2 on the processor, loaded at run time.
//!
//! Besides the Embree layer, this is the only module with `unsafe`. [`Oidn`] is its safe interface.

mod cancellation;
mod library;

use super::Guides;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use cancellation::{Cancellation, goes_on};
use glam::Vec3;
use library::{Functions, Handle};
use serde::{Deserialize, Serialize};
use std::ffi::{CStr, c_int, c_void};
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// `OIDN_DEVICE_TYPE_CPU`.
const CPU: c_int = 1;

/// `OIDN_FORMAT_FLOAT3`, as [`Vec3`] is laid out.
const FLOAT3: c_int = 3;
const _: () = assert!(size_of::<Vec3>() == 12 && align_of::<Vec3>() == 4);

/// `OIDN_ERROR_CANCELLED`.
const CANCELED: c_int = 6;

/// Number of filters that are kept: one for the whole image, and one for its tiles. Each holds
/// copies of its images.
const MAX_FILTERS: usize = 2;

/// Size of the neural network. On a processor, a run of `High` with clean guides takes about five
/// times as long as a run of `Fast`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quality {
    /// `OIDN_QUALITY_FAST`.
    Fast = 4,
    /// `OIDN_QUALITY_HIGH`.
    High = 6,
}

/// A denoiser on the processor.
#[derive(Debug)]
pub struct Oidn {
    device: Handle,
    functions: Functions,
    quality: Quality,
    /// The interrupt that ends a run.
    cancellation: Arc<Cancellation>,
    /// The latest filters, at most [`MAX_FILTERS`]. A run with the parameters of one of them uses
    /// it again.
    filters: Vec<Filter>,
}

// SAFETY: the handle is not bound to a thread, and `&mut self` keeps all of its functions from
// running twice at a time.
unsafe impl Send for Oidn {}

impl Drop for Oidn {
    fn drop(&mut self) {
        self.filters.clear();
        // SAFETY: the handle is that of `oidnNewDevice`, released once; its filters were released
        // in the line above.
        unsafe { (self.functions.release_device)(self.device) };
    }
}

impl Oidn {
    /// Loads the library for this number of threads.
    ///
    /// # Errors
    /// If the library is not installed (with advice how to install it), or does not run on this
    /// processor.
    pub fn new(threads: usize) -> Result<Self> {
        let functions = library::load()?;
        // SAFETY: takes a number that the reference lists.
        let device = unsafe { (functions.new_device)(CPU) };
        if device.is_null() {
            let problem = "Open Image Denoise does not run on this processor";
            return Err(Error::new(problem, "render without denoising"));
        }
        let oidn = Self {
            device,
            functions,
            quality: Quality::High,
            cancellation: Arc::default(),
            filters: Vec::new(),
        };
        let threads = c_int::try_from(threads).unwrap_or(0);
        // SAFETY: the device lives, names end in a zero byte, and types are those that the
        // reference gives.
        unsafe {
            (oidn.functions.set_device_int)(device, c"numThreads".as_ptr(), threads);
            // Other programs may run beside this one.
            (oidn.functions.set_device_bool)(device, c"setAffinity".as_ptr(), false);
            (oidn.functions.commit_device)(device);
        }
        oidn.check()?;
        Ok(oidn)
    }

    /// The version of the library, such as `2.5.1`.
    pub fn version(&self) -> String {
        // SAFETY: as above.
        let version = unsafe { (self.functions.get_device_int)(self.device, c"version".as_ptr()) };
        format!("{}.{}.{}", version / 10_000, version / 100 % 100, version % 100)
    }

    /// Cancels runs once this flag is set. They then fail with an error that
    /// [is an interrupt](Error::is_interrupt).
    #[must_use]
    pub fn interrupted_by(mut self, interrupt: Arc<AtomicBool>) -> Self {
        self.filters.clear(); // They know the earlier flag.
        self.cancellation = Arc::new(Cancellation::new(interrupt));
        self
    }

    /// Lets later runs ignore the interrupt until this time; `None` for none.
    pub fn run_until(&mut self, time: Option<Instant>) {
        self.cancellation.ignore_until(time);
    }

    /// Sets the quality of all later runs [default: high].
    pub fn set_quality(&mut self, quality: Quality) {
        self.quality = quality;
    }

    /// Denoises an image of `width` by `height` pixels of linear radiance of any scale, row by row.
    /// Albedo and normals guide the denoiser, if there are any.
    ///
    /// # Errors
    /// If the library fails, such as for lack of memory.
    ///
    /// # Panics
    /// Unless there is one value per pixel of each image.
    pub fn denoise(
        &mut self,
        size: (u32, u32),
        radiance: &[Rgb],
        guides: &Guides,
    ) -> Result<Vec<Rgb>> {
        let Guides { albedo, normal, clean } = guides;
        if albedo.is_empty() {
            return self.run(size, &[(c"color", radiance)], &[(c"hdr", true)]);
        }
        let images = [(c"color", radiance), (c"albedo", &albedo[..]), (c"normal", &normal[..])];
        self.run(size, &images, &[(c"hdr", true), (c"cleanAux", *clean)])
    }

    /// Denoises guides, unless they are clean. The denoiser keeps more detail with clean guides.
    ///
    /// # Errors
    /// As [`Self::denoise`].
    ///
    /// # Panics
    /// As [`Self::denoise`].
    pub fn prefilter(&mut self, size: (u32, u32), guides: Guides) -> Result<Guides> {
        if guides.clean || guides.albedo.is_empty() {
            return Ok(guides);
        }
        let albedo = self.run(size, &[(c"albedo", &guides.albedo)], &[])?;
        let normal = self.run(size, &[(c"normal", &guides.normal)], &[])?;
        Ok(Guides { albedo, normal, clean: true })
    }

    /// Runs a filter for ray-traced images once, unless the run is canceled.
    fn run(
        &mut self,
        size: (u32, u32),
        inputs: &[(&'static CStr, &[Vec3])],
        switches: &[(&'static CStr, bool)],
    ) -> Result<Vec<Rgb>> {
        if self.cancellation.is_canceled() {
            return Err(canceled());
        }
        let names = inputs.iter().map(|(name, _)| *name).collect();
        let key = FilterKey { size, names, switches: switches.to_vec(), quality: self.quality };
        let mut filter = match self.filters.iter().position(|filter| filter.key == key) {
            Some(index) => self.filters.remove(index),
            None => self.new_filter(key)?,
        };
        for (own, (_, image)) in filter.inputs.iter_mut().zip(inputs) {
            own.copy_from_slice(image); // Panics unless there is one value per pixel.
        }
        // SAFETY: the filter was committed. Its images live as long as it does, and nothing else
        // reads or writes them until the call returns, when the filter is done.
        unsafe { (self.functions.execute_filter)(filter.handle) };
        self.check()?;
        let output = filter.output.clone();
        self.filters.push(filter);
        let surplus = self.filters.len().saturating_sub(MAX_FILTERS);
        self.filters.drain(..surplus);
        Ok(output)
    }

    fn new_filter(&self, key: FilterKey) -> Result<Filter> {
        let (width, height) = (key.size.0 as usize, key.size.1 as usize);
        // SAFETY: the device lives, and the name is one of the reference.
        let handle = unsafe { (self.functions.new_filter)(self.device, c"RT".as_ptr()) };
        if handle.is_null() {
            self.check()?;
            return Err(Error::new(
                "Open Image Denoise cannot create a filter",
                "free some memory",
            ));
        }
        let black = vec![Rgb::ZERO; width * height];
        let inputs = vec![black.clone(); key.names.len()];
        let release = self.functions.release_filter;
        let cancellation = Arc::clone(&self.cancellation);
        let mut filter = Filter { handle, release, key, inputs, output: black, cancellation };
        let set = |name: &CStr, data: *mut c_void| {
            // SAFETY: `data` points to `width * height` packed triples of f32. The filter owns
            // these images, never resizes them, and is released before they are dropped.
            unsafe {
                let set = self.functions.set_shared_filter_image;
                set(handle, name.as_ptr(), data, FLOAT3, width, height, 0, 0, 0);
            }
        };
        for (name, image) in filter.key.names.iter().zip(&mut filter.inputs) {
            set(name, image.as_mut_ptr().cast());
        }
        set(c"output", filter.output.as_mut_ptr().cast());
        for (name, value) in &filter.key.switches {
            // SAFETY: the filter lives, and the name is one of the reference.
            unsafe { (self.functions.set_filter_bool)(handle, name.as_ptr(), *value) };
        }
        let cancellation = Arc::as_ptr(&filter.cancellation).cast_mut().cast();
        // SAFETY: the filter lives. `goes_on` has the type of the reference. Its pointer is that of
        // a `Cancellation`, which the filter keeps alive until it is released.
        unsafe { (self.functions.set_filter_progress_monitor)(handle, goes_on, cancellation) };
        // SAFETY: the filter lives, the name and the value are among those of the reference, and
        // all images are set.
        unsafe {
            let quality = filter.key.quality as c_int;
            (self.functions.set_filter_int)(handle, c"quality".as_ptr(), quality);
            (self.functions.commit_filter)(handle);
        }
        self.check()?;
        Ok(filter)
    }

    /// The library's error, if there is one.
    fn check(&self) -> Result<()> {
        let mut text = ptr::null();
        // SAFETY: the device lives; the text is written where there is room for its address.
        let code = unsafe { (self.functions.get_device_error)(self.device, &mut text) };
        if code == 0 {
            return Ok(());
        }
        if code == CANCELED {
            return Err(canceled());
        }
        let text = if text.is_null() {
            String::new()
        } else {
            // SAFETY: ends in a zero byte, and lives until the next call.
            unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
        };
        let help = "use a lower resolution, or render without denoising";
        Err(Error::new(format!("Open Image Denoise failed: {text} (error {code})"), help))
    }
}

/// The error of a canceled run.
fn canceled() -> Error {
    let advice = "let the denoiser end, or render without denoising";
    Error::new("denoising was interrupted", advice).by_interrupt()
}

/// Parameters of a filter.
#[derive(Debug, PartialEq)]
struct FilterKey {
    /// Width and height, pixels.
    size: (u32, u32),
    /// Names of the input images.
    names: Vec<&'static CStr>,
    switches: Vec<(&'static CStr, bool)>,
    quality: Quality,
}

/// A filter with its images. It is released when it is dropped.
#[derive(Debug)]
struct Filter {
    handle: Handle,
    release: unsafe extern "C" fn(Handle),
    key: FilterKey,
    /// Images that the filter reads, in the order of the names.
    inputs: Vec<Vec<Vec3>>,
    /// Image that the filter writes.
    output: Vec<Vec3>,
    /// Read by the library while the filter runs.
    cancellation: Arc<Cancellation>,
}

impl Drop for Filter {
    fn drop(&mut self) {
        // SAFETY: the handle is that of `oidnNewFilter`, released once, before its device,
        // its images and its cancellation.
        unsafe { (self.release)(self.handle) };
    }
}
