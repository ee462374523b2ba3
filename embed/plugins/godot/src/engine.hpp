// The thin layer between Godot's C interface and the nodes: values, calls by name, errors, and the registration of
// classes.
//
// It calls Godot by name, as scripts do, and not by method hashes. A call takes 0.1 us longer, but one small layer fits
// every version of Godot from 4.4 on; generated bindings fit only one. The layer uses only
// Surefoot's vectors, which it converts from and to Godot's.
#pragma once

#include "surefoot.h"

#include <gdextension_interface.h>

#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace engine {

using Type = GDExtensionVariantType;

// Finds the functions of the interface. To be called once, before anything else.
void connect(GDExtensionInterfaceGetProcAddress find, GDExtensionClassLibraryPtr library);

void unregister_class(const char* name);

// Show in the editor's and the game's log.
void push_error(const std::string& message);
void push_warning(const std::string& message);

// A value of any of Godot's types.
class Variant {
public:
    Variant();
    Variant(bool value);
    Variant(int64_t value);
    Variant(double value);
    Variant(const std::string& value);
    Variant(const char* value) : Variant(std::string(value)) {}
    Variant(sf_vec3 value);
    Variant(const Variant& other);
    Variant(Variant&& other) noexcept;
    Variant& operator=(Variant other) noexcept;
    ~Variant();

    // The empty value of a type, such as an empty dictionary.
    static Variant empty(Type type);
    // A value that a pointer of the C interface points at.
    static Variant from_pointer(Type type, const void* value);
    static Variant object(GDExtensionObjectPtr object);
    // The object with an id of get_instance_id; nil after it was freed.
    static Variant object_with(int64_t id);
    // One of the engine's singletons, such as "ClassDB".
    static Variant singleton(const char* name);

    Type type() const;
    bool is_nil() const { return type() == GDEXTENSION_VARIANT_TYPE_NIL; }
    // These return zeros, and no object, for values of another type.
    bool boolean() const;
    int64_t integer() const;
    double number() const;
    sf_vec3 vector3() const;
    std::string text() const;
    GDExtensionObjectPtr object() const;
    // The contents of a PackedByteArray.
    std::vector<uint8_t> bytes() const;
    // Writes the value to where a pointer of the C interface points.
    void to_pointer(Type type, void* value) const;

    // Element of an array or a dictionary; nil if there is none.
    Variant at(const Variant& key) const;
    void set(const Variant& key, const Variant& value);

    // Calls a method as a script does. `method` is a literal. What cannot be called is nil, and an error in the log.
    template <typename... Arguments>
    Variant call(const char* method, const Arguments&... arguments) const {
        const Variant values[] = {Variant(arguments)..., Variant()};
        return call_with(method, values, sizeof...(arguments));
    }

    const void* raw() const { return bytes_; }
    void* raw() { return bytes_; }

private:
    Variant call_with(const char* method, const Variant* arguments, size_t count) const;

    // The size of a Variant where Godot counts in single precision.
    alignas(8) unsigned char bytes_[24];
};

// Values whose type scripts know; made empty.
template <GDExtensionVariantType type_>
class Typed : public Variant {
public:
    Typed() : Variant(Variant::empty(type_)) {}
    explicit Typed(const Variant& value) : Variant(value) {}
};
using Dictionary = Typed<GDEXTENSION_VARIANT_TYPE_DICTIONARY>;
using Array = Typed<GDEXTENSION_VARIANT_TYPE_ARRAY>;
using PackedVector3Array = Typed<GDEXTENSION_VARIANT_TYPE_PACKED_VECTOR3_ARRAY>;

// A bound object of one of our classes. Godot creates and destroys it with its own object.
class Instance {
public:
    virtual ~Instance() = default;
    // What happens to a node; `what` is one of Notification.
    virtual void notified(int32_t what) { (void)what; }

    Variant self() const { return Variant::object(object_); }
    void bind(GDExtensionObjectPtr object) { object_ = object; }

    // Our part of an object; null if the object is not one of ours.
    static Instance* of(const Variant& object);

private:
    GDExtensionObjectPtr object_ = nullptr;
};

enum Notification : int32_t {
    NOTIFICATION_EXIT_TREE = 11,
    NOTIFICATION_READY = 13,
    NOTIFICATION_INTERNAL_PHYSICS_PROCESS = 26,
};

// How C++ types appear to scripts.
template <typename T>
struct Convert;
template <>
struct Convert<void> {
    static constexpr Type type = GDEXTENSION_VARIANT_TYPE_NIL;
};
template <>
struct Convert<bool> {
    static constexpr Type type = GDEXTENSION_VARIANT_TYPE_BOOL;
    static bool from(const Variant& value) { return value.boolean(); }
};
template <>
struct Convert<int64_t> {
    static constexpr Type type = GDEXTENSION_VARIANT_TYPE_INT;
    static int64_t from(const Variant& value) { return value.integer(); }
};
template <>
struct Convert<double> {
    static constexpr Type type = GDEXTENSION_VARIANT_TYPE_FLOAT;
    static double from(const Variant& value) { return value.number(); }
};
template <>
struct Convert<std::string> {
    static constexpr Type type = GDEXTENSION_VARIANT_TYPE_STRING;
    static std::string from(const Variant& value) { return value.text(); }
};
template <>
struct Convert<sf_vec3> {
    static constexpr Type type = GDEXTENSION_VARIANT_TYPE_VECTOR3;
    static sf_vec3 from(const Variant& value) { return value.vector3(); }
};
template <GDExtensionVariantType type_>
struct Convert<Typed<type_>> {
    static constexpr Type type = type_;
    static Typed<type_> from(const Variant& value) { return Typed<type_>(value); }
};
// Values of any type.
template <>
struct Convert<Variant> {
    static constexpr Type type = GDEXTENSION_VARIANT_TYPE_NIL;
    static Variant from(const Variant& value) { return value; }
};

// A method as it is registered.
struct Method {
    using Call = Variant (*)(Instance& instance, const Variant* arguments);

    std::string name;
    std::vector<std::string> argument_names;
    std::vector<Type> argument_types;
    // Values of the last arguments if they are left out.
    std::vector<Variant> defaults;
    Type result = GDEXTENSION_VARIANT_TYPE_NIL;
    bool has_result = false;
    Call call = nullptr;
};

// A property in the inspector. `hint` and `hint_text` are those of PropertyInfo; `class_name` is for objects.
struct Property {
    std::string name;
    Type type;
    uint32_t hint = 0;
    std::string hint_text;
    std::string class_name;
};

// Registers a class, then its members.
class ClassBuilder {
public:
    using Create = std::unique_ptr<Instance> (*)();

    // A runtime class does nothing while its scene is edited.
    ClassBuilder(const char* name, const char* parent, bool is_runtime, Create create);

    // `member` is a member function; its types decide those that scripts see.
    template <auto member>
    ClassBuilder& method(const char* name, std::vector<std::string> argument_names = {}, std::vector<Variant> defaults = {}) {
        Method method = describe<member>(member);
        method.name = name;
        method.argument_names = std::move(argument_names);
        method.defaults = std::move(defaults);
        add(std::move(method));
        return *this;
    }
    template <auto getter, auto setter>
    ClassBuilder& property(const Property& property) {
        method<getter>(("get_" + property.name).c_str());
        method<setter>(("set_" + property.name).c_str(), {property.name});
        add(property);
        return *this;
    }
    ClassBuilder& group(const char* name);
    ClassBuilder& signal(const char* name, const std::vector<std::pair<std::string, Type>>& arguments = {});

private:
    template <auto member, typename Object, typename Result, typename... Arguments>
    static Method describe(Result (Object::*)(Arguments...)) {
        return describe_as<member, Object, Result, Arguments...>();
    }
    template <auto member, typename Object, typename Result, typename... Arguments>
    static Method describe(Result (Object::*)(Arguments...) const) {
        return describe_as<member, Object, Result, Arguments...>();
    }
    template <auto member, typename Object, typename Result, typename... Arguments>
    static Method describe_as() {
        Method method;
        method.argument_types = {Convert<std::decay_t<Arguments>>::type...};
        method.result = Convert<std::decay_t<Result>>::type;
        method.has_result = !std::is_void_v<Result>;
        method.call = [](Instance& instance, const Variant* arguments) -> Variant {
            return invoke<member, Object, Result, Arguments...>(instance, arguments, std::index_sequence_for<Arguments...>());
        };
        return method;
    }
    template <auto member, typename Object, typename Result, typename... Arguments, size_t... idx>
    static Variant invoke(Instance& instance, [[maybe_unused]] const Variant* arguments, std::index_sequence<idx...>) {
        Object& object = static_cast<Object&>(instance);
        if constexpr (std::is_void_v<Result>) {
            (object.*member)(Convert<std::decay_t<Arguments>>::from(arguments[idx])...);
            return Variant();
        } else {
            return Variant((object.*member)(Convert<std::decay_t<Arguments>>::from(arguments[idx])...));
        }
    }

    void add(Method method);
    void add(const Property& property);

    std::string name_;
};

}  // namespace engine
