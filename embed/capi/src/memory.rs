//! Converts pointers of callers to references, slices and handles, or to errors that name the argument.
//!
//! The header states what a caller guarantees for a pointer that is neither null nor misaligned: it points to as many
//! values as the call says, no other thread writes them during the call, and a handle was made by this library and not
//! destroyed.

use crate::abi::{self, Growing};
use crate::error::{Fault, Status};
use std::ffi::{CStr, c_char};
use std::fmt::Display;
use std::mem::MaybeUninit;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, MutexGuard, TryLockError};

/// Runs a call, writes its error into `error`, unless that is null, and returns the status. Panics are caught.
///
/// # Safety
/// `error` is null or points to an error.
pub(crate) unsafe fn guard(error: *mut abi::Error, call: impl FnOnce() -> Result<(), Fault>) -> i32 {
    let crashed = |_| {
        let message = "a fault of the library: please report it; destroy the handles of this call";
        Err(Fault::new(Status::Internal, message))
    };
    // State after a panic is behind a lock, which is then poisoned.
    let Err(fault) = catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(crashed) else { return Status::Ok as i32 };
    if !error.is_null() && error.is_aligned() {
        // SAFETY: the caller's pointer is neither null nor misaligned.
        unsafe { error.write(fault.to_abi()) };
    }
    fault.status as i32
}

fn check<T>(pointer: *const T, name: impl Display) -> Result<(), Fault> {
    if pointer.is_null() {
        return Err(Fault::argument(format!("{name} is NULL")));
    }
    if !pointer.is_aligned() {
        return Err(Fault::argument(format!("{name} is not aligned to {} bytes", align_of::<T>())));
    }
    Ok(())
}

/// The value at the pointer `name`.
///
/// # Safety
/// `pointer` is null or as the header requires; the reference is not kept beyond the call.
pub(crate) unsafe fn reference<'a, T>(pointer: *const T, name: &str) -> Result<&'a T, Fault> {
    check(pointer, name)?;
    // SAFETY: neither null nor misaligned, and as the header says.
    Ok(unsafe { &*pointer })
}

/// Writes an output.
///
/// # Safety
/// As for [`reference`].
pub(crate) unsafe fn write<T>(pointer: *mut T, name: impl Display, value: T) -> Result<(), Fault> {
    check(pointer, name)?;
    // SAFETY: neither null nor misaligned, and as the header says.
    unsafe { pointer.write(value) };
    Ok(())
}

/// The values of an array; a null pointer to none is allowed.
///
/// # Safety
/// As for [`reference`], with `count` values.
pub(crate) unsafe fn slice<'a, T>(pointer: *const T, count: usize, name: &str) -> Result<&'a [T], Fault> {
    if count == 0 {
        return Ok(&[]);
    }
    check(pointer, name)?;
    check_count::<T>(count, name)?;
    // SAFETY: neither null nor misaligned, no longer than memory, and as the header says.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// The values of an output array.
///
/// # Safety
/// As for [`slice`].
pub(crate) unsafe fn slice_mut<'a, T>(pointer: *mut T, count: usize, name: &str) -> Result<&'a mut [T], Fault> {
    if count == 0 {
        return Ok(&mut []);
    }
    check(pointer, name)?;
    check_count::<T>(count, name)?;
    // SAFETY: neither null nor misaligned, no longer than memory, and as the header says.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer, count) })
}

fn check_count<T>(count: usize, name: &str) -> Result<(), Fault> {
    let fits = count.checked_mul(size_of::<T>()).is_some_and(|bytes| isize::try_from(bytes).is_ok());
    if fits { Ok(()) } else { Err(Fault::argument(format!("{name} has {count} values, more than memory"))) }
}

/// Copies `values` to an array with room for `capacity`, and writes their number.
///
/// # Safety
/// As for [`slice_mut`] and [`write`].
pub(crate) unsafe fn fill<T: Copy>(
    pointer: *mut T,
    capacity: usize,
    count: *mut usize,
    name: &str,
    values: &[T],
) -> Result<(), Fault> {
    // SAFETY: passed on.
    let room = unsafe {
        write(count, format_args!("the count of {name}"), values.len())?;
        slice_mut(pointer, capacity, name)?
    };
    let room = room.get_mut(..values.len()).ok_or_else(|| {
        let message = format!("{name} has room for {capacity}, but there are {}: make it larger", values.len());
        Fault::new(Status::BufferTooSmall, message)
    })?;
    room.copy_from_slice(values);
    Ok(())
}

/// Text in UTF-8 that ends with a zero.
///
/// # Safety
/// As for [`reference`].
pub(crate) unsafe fn text<'a>(pointer: *const c_char, name: &str) -> Result<&'a str, Fault> {
    check(pointer, name)?;
    // SAFETY: not null, and as the header says.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|_| Fault::argument(format!("{name} is not UTF-8")))
}

/// A struct that may grow, with the fields of this version.
///
/// # Safety
/// As for [`reference`]; the struct has the size in its first field.
pub(crate) unsafe fn growing<T: Growing>(pointer: *const T, name: &str) -> Result<T, Fault> {
    check(pointer, name)?;
    // SAFETY: its size comes first.
    let size = unsafe { pointer.cast::<u32>().read() } as usize;
    check_size::<T>(size, name)?;
    // SAFETY: the struct has that many bytes. What the caller lacks stays 0, which all these structs allow.
    unsafe {
        let bytes = slice(pointer.cast::<u8>(), size, name)?;
        let (known, beyond) = bytes.split_at(size.min(size_of::<T>()));
        if beyond.iter().any(|byte| *byte != 0) {
            let message = format!("{name} uses fields of a later version of {}: update the library", T::NAME);
            return Err(Fault::argument(message));
        }
        let mut value = MaybeUninit::<T>::zeroed();
        value.as_mut_ptr().cast::<u8>().copy_from_nonoverlapping(pointer.cast(), known.len());
        Ok(value.assume_init())
    }
}

/// Struct `idx` of an array of structs that may grow; all are as large as the first.
///
/// # Safety
/// As for [`growing`], with more than `idx` structs.
pub(crate) unsafe fn growing_at<T: Growing>(pointer: *const T, idx: usize, name: &str) -> Result<T, Fault> {
    check(pointer, name)?;
    // SAFETY: the first struct has the size of each, and there are enough of them.
    let at = unsafe { pointer.byte_add(idx * pointer.cast::<u32>().read() as usize) };
    // SAFETY: passed on.
    unsafe { growing(at, name) }
}

/// Writes a struct that may grow over one in which the caller has set its size.
///
/// # Safety
/// As for [`growing`].
pub(crate) unsafe fn write_growing<T: Growing>(pointer: *mut T, name: &str, value: T) -> Result<(), Fault> {
    check(pointer, name)?;
    // SAFETY: its size comes first.
    let size = unsafe { pointer.cast::<u32>().read() };
    check_size::<T>(size as usize, name)?;
    // SAFETY: no more is written than the caller's struct has room for; it keeps its size.
    unsafe {
        let bytes = (&raw const value).cast::<u8>();
        pointer.cast::<u8>().copy_from_nonoverlapping(bytes, size_of::<T>().min(size as usize));
        pointer.cast::<u32>().write(size);
    }
    Ok(())
}

fn check_size<T: Growing>(size: usize, name: &str) -> Result<(), Fault> {
    /// Larger than any struct will ever be.
    const MOST: usize = 4096;
    if (T::FIRST_SIZE..=MOST).contains(&size) {
        return Ok(());
    }
    Err(Fault::argument(format!("{name}.struct_size is {size}: set it to sizeof({})", T::NAME)))
}

/// Gives a value to the caller as a handle.
///
/// # Safety
/// As for [`write`].
pub(crate) unsafe fn hand_out<T>(out: *mut *mut T, name: &str, value: T) -> Result<(), Fault> {
    check(out, name)?;
    // SAFETY: passed on.
    unsafe { write(out, name, Box::into_raw(Box::new(value))) }
}

/// Destroys a handle; null is allowed.
///
/// # Safety
/// `handle` is null, or was [handed out](hand_out) and not destroyed.
pub(crate) unsafe fn destroy<T>(handle: *mut T) {
    if !handle.is_null() {
        // SAFETY: it was made from a box.
        let dropped = catch_unwind(AssertUnwindSafe(|| drop(unsafe { Box::from_raw(handle) })));
        debug_assert!(dropped.is_ok());
    }
}

/// The state of a handle that one thread uses at a time.
pub(crate) fn lock<'a, T>(state: &'a Mutex<T>, name: &str) -> Result<MutexGuard<'a, T>, Fault> {
    state.try_lock().map_err(|error| match error {
        TryLockError::WouldBlock => Fault::new(Status::Busy, format!("another call with {name} is running")),
        TryLockError::Poisoned(_) => spoilt(name),
    })
}

/// A handle that is unusable after a fault of the library.
pub(crate) fn spoilt(name: &str) -> Fault {
    Fault::new(Status::Internal, format!("{name} is unusable after a fault of the library: destroy it"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ptr::null_mut;

    #[test]
    fn a_panic_becomes_a_status_and_its_handle_is_unusable() {
        let handle = Mutex::new(0);
        let mut error = abi::Error { code: 0, message: [0; abi::MESSAGE_LEN] };
        let call = || {
            let _state = lock(&handle, "handle")?;
            panic!("a fault");
        };
        // SAFETY: the error is there.
        assert_eq!(unsafe { guard(&mut error, call) }, Status::Internal as i32);
        assert_eq!(error.code, Status::Internal as i32);
        // SAFETY: errors may be null.
        let status = unsafe { guard(null_mut(), || lock(&handle, "handle").map(drop)) };
        assert_eq!(status, Status::Internal as i32);
    }

    #[test]
    fn a_text_that_is_too_long_is_cut_off_between_characters() {
        let message = Fault::argument("\u{20ac}".repeat(200)).to_abi().message;
        let end = message.iter().position(|byte| *byte == 0).expect("a zero");
        assert_eq!(end, abi::MESSAGE_LEN - 1, "255 is a multiple of three");
        let text = Fault::argument("x".to_owned() + &"\u{20ac}".repeat(200)).to_abi().message;
        assert_eq!(text.iter().position(|byte| *byte == 0), Some(abi::MESSAGE_LEN - 3));
    }
}
