// What tests expect; the first that is not so ends the program.
#pragma once

#include "SurefootAdapter.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>

inline void expect(bool holds, const std::string& what) {
    if (!holds) {
        std::fprintf(stderr, "not so: %s\n", what.c_str());
        std::exit(1);
    }
}

// Makes no text unless it is needed, since it is called while allocations are counted.
inline void expect_near(double found, double expected, double difference, const char* what) {
    if (!(std::abs(found - expected) <= difference)) {
        expect(false, std::string(what) + " is " + std::to_string(found) + ", not " + std::to_string(expected));
    }
}

inline void expect_near(const surefoot::Vector& found, const surefoot::Vector& expected, double centimetres, const std::string& what) {
    expect(surefoot::distance(found, expected) <= centimetres, what + " is (" + std::to_string(found.x) + ", " + std::to_string(found.y) + ", "
                                                                    + std::to_string(found.z) + ")");
}

inline void must(const surefoot::Error& error) {
    expect(!error.is_set(), error.text);
}

// For calls of the library itself, which write an error only if they fail.
inline void must(sf_status status, const sf_error& error) {
    if (status != SF_OK) {
        expect(false, error.message);
    }
}

template <typename Value>
Value must(surefoot::Result<Value> result) {
    expect(bool(result), result.error.text);
    return std::move(*result.value);
}

inline void expect_error(const surefoot::Error& error, sf_status code, const std::string& words) {
    expect(error.code == code, "the status is " + std::to_string(error.code) + ", not " + std::to_string(code) + ": " + error.text);
    expect(error.text.find(words) != std::string::npos, "'" + error.text + "' has the words '" + words + "'");
}

template <typename Value>
void expect_error(const surefoot::Result<Value>& result, sf_status code, const std::string& words) {
    expect(!result, "there is an error with '" + words + "'");
    expect_error(result.error, code, words);
}
