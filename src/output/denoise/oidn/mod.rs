//! Intel Open Image Denoise 2 on the processor, loaded at run time.
//!
//! Besides the Embree layer, this is the only module with `unsafe`. [`Oidn`] is its safe interface.

mod library;

use super::Guides;
use crate::base::error::{Error, Result};
use crate::base::math::Rgb;
use glam::Vec3;
use library::{Functions, Handle};
use std::ffi::{CStr, c_int, c_void};
use std::ptr;

/// `OIDN_DEVICE_TYPE_CPU`.
const CPU: c_int = 1;

/// `OIDN_FORMAT_FLOAT3`, as [`Vec3`] is laid out.
const FLOAT3: c_int = 3;
const _: () = assert!(size_of::<Vec3>() == 12 && align_of::<Vec3>() == 4);

/// A denoiser on the processor.
#[derive(Debug)]
pub struct Oidn {
    device: Handle,
    functions: Functions,
}

// SAFETY: the handle is not bound to a thread, and `&mut self` keeps all of its functions from running twice at a time.
unsafe impl Send for Oidn {}

impl Drop for Oidn {
    fn drop(&mut self) {
        // SAFETY: the handle is that of `oidnNewDevice`, released once; filters are released before by `Filter`.
        unsafe { (self.functions.release_device)(self.device) };
    }
}

impl Oidn {
    /// Loads the library for this number of threads.
    ///
    /// # Errors
    /// If the library is not installed (with advice how to install it), or does not run on this processor.
    pub fn new(threads: usize) -> Result<Self> {
        let functions = library::load()?;
        // SAFETY: takes a number that the reference lists.
        let device = unsafe { (functions.new_device)(CPU) };
        if device.is_null() {
            let problem = "Open Image Denoise does not run on this processor";
            return Err(Error::new(problem, "render without denoising"));
        }
        let oidn = Self { device, functions };
        let threads = c_int::try_from(threads).unwrap_or(0);
        // SAFETY: the device lives, names end in a zero byte, and types are those that the reference gives.
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

    /// Denoises an image of `width` by `height` pixels of linear radiance of any scale, row by row. Albedo and normals
    /// guide the denoiser, if there are any. Unless they are clean, they are denoised first, which takes three times as
    /// long.
    ///
    /// # Errors
    /// If the library fails, such as for lack of memory.
    ///
    /// # Panics
    /// Unless there is one value per pixel of each image.
    pub fn denoise(
        &mut self,
        (width, height): (u32, u32),
        radiance: &[Rgb],
        guides: &Guides,
    ) -> Result<Vec<Rgb>> {
        let size = (width as usize, height as usize);
        let Guides { albedo, normal, clean } = guides;
        if albedo.is_empty() {
            return self.run(size, &[(c"color", radiance)], &[(c"hdr", true)]);
        }
        let filtered = if *clean {
            None
        } else {
            let albedo = self.run(size, &[(c"albedo", albedo)], &[])?;
            Some((albedo, self.run(size, &[(c"normal", normal)], &[])?))
        };
        let (albedo, normal) = match &filtered {
            Some((albedo, normal)) => (&albedo[..], &normal[..]),
            None => (&albedo[..], &normal[..]),
        };
        let images = [(c"color", radiance), (c"albedo", albedo), (c"normal", normal)];
        self.run(size, &images, &[(c"hdr", true), (c"cleanAux", true)])
    }

    /// Runs a filter for ray-traced images once.
    fn run(
        &mut self,
        (width, height): (usize, usize),
        inputs: &[(&CStr, &[Vec3])],
        switches: &[(&CStr, bool)],
    ) -> Result<Vec<Rgb>> {
        let mut output = vec![Rgb::ZERO; width * height];
        // SAFETY: the device lives, and the name is one of the reference.
        let handle = unsafe { (self.functions.new_filter)(self.device, c"RT".as_ptr()) };
        if handle.is_null() {
            self.check()?;
            return Err(Error::new(
                "Open Image Denoise cannot create a filter",
                "free some memory",
            ));
        }
        let filter = Filter { handle, functions: &self.functions };
        let set = |name: &CStr, data: *mut c_void| {
            // SAFETY: `data` points to `width * height` packed triples of f32, asserted of inputs below and true of the
            // output; they outlive the filter, which is released before this function ends. Inputs are read only.
            unsafe {
                let set = self.functions.set_shared_filter_image;
                set(filter.handle, name.as_ptr(), data, FLOAT3, width, height, 0, 0, 0);
            }
        };
        for (name, image) in inputs {
            assert_eq!(image.len(), width * height, "one value per pixel");
            set(name, image.as_ptr().cast_mut().cast());
        }
        set(c"output", output.as_mut_ptr().cast());
        for (name, value) in switches {
            // SAFETY: the filter lives, and the name is one of the reference.
            unsafe { (self.functions.set_filter_bool)(filter.handle, name.as_ptr(), *value) };
        }
        // SAFETY: all images are set, and `output` is touched by nothing else until the filter is done: the call
        // returns then.
        unsafe {
            (self.functions.commit_filter)(filter.handle);
            (self.functions.execute_filter)(filter.handle);
        }
        drop(filter);
        self.check()?;
        Ok(output)
    }

    /// The library's error, if there is one.
    fn check(&self) -> Result<()> {
        let mut text = ptr::null();
        // SAFETY: the device lives; the text is written where there is room for its address.
        let code = unsafe { (self.functions.get_device_error)(self.device, &mut text) };
        if code == 0 {
            return Ok(());
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

/// A filter that is released when it is dropped.
struct Filter<'a> {
    handle: Handle,
    functions: &'a Functions,
}

impl Drop for Filter<'_> {
    fn drop(&mut self) {
        // SAFETY: the handle is that of `oidnNewFilter`, released once, before its device.
        unsafe { (self.functions.release_filter)(self.handle) };
    }
}
