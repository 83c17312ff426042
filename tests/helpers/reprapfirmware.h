/* What Grid.cpp and the transforms of RepRapFirmware need of the rest of the firmware: three axes, one tool without
 * offsets, strings and a file. Nothing here interpolates or corrects. */
#pragma once

#include <algorithm>
#include <bitset>
#include <cinttypes>
#include <cmath>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <functional>

#define SUPPORT_OBJECT_MODEL 0
#define SUPPORT_PROBE_POINTS_FILE 0
#define HAS_MASS_STORAGE 1
#define HAS_SBC_INTERFACE 0
#define HAS_LINUX_INTERFACE 0
#define INHERIT_OBJECT_MODEL
#define DECLARE_OBJECT_MODEL
#define DECLARE_OBJECT_MODEL_WITH_ARRAYS
#define pre(...)
#define _ecv_array
#define _ecv_null
#define ARRAY_SIZE(a) (sizeof(a) / sizeof((a)[0]))
#define ARRAY_UPB(a) (ARRAY_SIZE(a) - 1)

constexpr size_t MaxGridProbePoints = 441, MaxAxis0GridPoints = 41; /* the boards with the least memory */
constexpr size_t MaxAxes = 3, X_AXIS = 0, Y_AXIS = 1, Z_AXIS = 2, MaxFilenameLength = 120, StringLength500 = 500;

template <class T> inline T max(T a, T b) { return a > b ? a : b; }
inline float fsquare(float v) { return v * v; }
inline double dsquare(double v) { return v * v; }
inline float fastSqrtf(float v) { return sqrtf(v); }
inline float SafeStrtof(const char *s, const char **end) { return strtof(s, const_cast<char **>(end)); }
inline uint32_t StrToU32(const char *s, const char **end) { return strtoul(s, const_cast<char **>(end), 10); }
inline bool StringStartsWith(const char *s, const char *start) { return !strncmp(s, start, strlen(start)); }

class StringRef {
    char *text;
    size_t size;
public:
    StringRef(char *t, size_t n) : text(t), size(n) {}
    const char *c_str() const { return text; }
    void Clear() const { text[0] = 0; }
    void cat(const char *more) const { strncat(text, more, size - strlen(text) - 1); }
    void cat(char c) const { char one[2] = {c, 0}; cat(one); }
    void copy(const char *from) const { Clear(); cat(from); }
    void catf(const char *form, ...) const {
        va_list list;
        va_start(list, form);
        vsnprintf(text + strlen(text), size - strlen(text), form, list);
        va_end(list);
    }
    template <class... A> void printf(const char *form, A... a) const { Clear(); catf(form, a...); }
};

template <size_t N> class String {
    char text[N + 1] = {0};
public:
    StringRef GetRef() { return StringRef(text, N + 1); }
    const char *c_str() const { return text; }
    void Clear() { text[0] = 0; }
    void copy(const char *from) { GetRef().copy(from); }
};

template <size_t N> class LargeBitmap {
    std::bitset<N> bits;
public:
    void ClearAll() { bits.reset(); }
    void SetBit(size_t k) { bits.set(k); }
    void ClearBit(size_t k) { bits.reset(k); }
    bool IsBitSet(size_t k) const { return bits[k]; }
};

class Deviation {
public:
    void Set(double, double, unsigned) {}
    double GetMean() const { return 0.0; }
    double GetDeviationFromMean() const { return 0.0; }
};

class FileStore {
    FILE *in;
public:
    explicit FileStore(FILE *f) : in(f) {}
    bool Write(const char *) { return true; }
    int ReadLine(char *buffer, size_t size) { /* a line that is longer is no line of this file */
        if (!fgets(buffer, size, in)) return -1;
        size_t end = strcspn(buffer, "\r\n");
        if (!buffer[end] && !feof(in)) return -1;
        buffer[end] = 0;
        return end;
    }
};

struct GCodes {
    size_t GetAxisNumberForLetter(char c) const { return c >= 'X' && c <= 'Z' ? c - 'X' : 99; }
    size_t GetVisibleAxes() const { return MaxAxes; }
};
struct Platform {
    bool GetDateTime(tm &) const { return false; }
};
struct RepRap {
    GCodes codes;
    Platform platform;
    GCodes &GetGCodes() { return codes; }
    Platform &GetPlatform() { return platform; }
    void MoveUpdated() {}
};
inline RepRap reprap;

struct AxesBitmap {
    unsigned bits;
    bool IsBitSet(size_t k) const { return bits >> k & 1; }
    size_t LowestSetBit() const { return __builtin_ctz(bits); }
    template <class F> void Iterate(F f) const {
        for (unsigned k = 0, n = 0; k < MaxAxes; k++)
            if (IsBitSet(k)) f(k, n++);
    }
};
/* newer than 3.6: what the map says at one pair of axes, handed to a function */
struct HeightCorrectionSample {
    unsigned axis0, axis1;
    float x, y, mapX, mapY, correction;
};
template <class F> struct function_ref_noexcept;
template <class R, class... A> struct function_ref_noexcept<R(A...) noexcept> : std::function<R(A...)> {
    using std::function<R(A...)>::function;
};
struct Tool {
    static AxesBitmap GetXAxes(const Tool *) { return {1u << X_AXIS}; }
    static AxesBitmap GetYAxes(const Tool *) { return {1u << Y_AXIS}; }
    static AxesBitmap GetAxisMapping(const Tool *, unsigned axis) { return {1u << axis}; }
    static float GetOffset(const Tool *, size_t) { return 0.0; }
};
