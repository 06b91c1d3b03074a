#include <embree4/rtcore.h>

/* bindgen skips macros that contain a cast; constants hand it their values. */
static const unsigned int RTC_INVALID_ID = RTC_INVALID_GEOMETRY_ID;
