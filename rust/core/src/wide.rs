//! The hot loops once for every width of the processor's vector registers.

/// Defines a function that runs `body`, an `#[inline(always)]` function of the same signature, as compiled for the widest
/// registers that the processor turns out to have. No fused operations, so the bits are the same with all of them.
macro_rules! wide {
    ($(#[$doc:meta])* $visible:vis fn $name:ident($($argument:ident: $type:ty),* $(,)?) -> $result:ty = $body:path;) => {
        $(#[$doc])*
        $visible fn $name($($argument: $type),*) -> $result {
            #[cfg(all(feature = "std", target_arch = "x86_64"))]
            {
                #[target_feature(enable = "avx512f")]
                fn eight($($argument: $type),*) -> $result {
                    $body($($argument),*)
                }
                #[target_feature(enable = "avx2")]
                fn four($($argument: $type),*) -> $result {
                    $body($($argument),*)
                }
                if std::arch::is_x86_feature_detected!("avx512f") {
                    // SAFETY: the processor has the feature that the function was compiled for, as just asked.
                    return unsafe { eight($($argument),*) };
                }
                if std::arch::is_x86_feature_detected!("avx2") {
                    // SAFETY: as above.
                    return unsafe { four($($argument),*) };
                }
            }
            $body($($argument),*)
        }
    };
}
pub(crate) use wide;
