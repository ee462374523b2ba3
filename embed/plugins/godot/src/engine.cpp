#include "engine.hpp"

#include <cstring>
#include <unordered_map>

namespace engine {

namespace {

// What this layer uses of the interface.
struct Interface {
    GDExtensionInterfaceVariantNewNil variant_new_nil;
    GDExtensionInterfaceVariantNewCopy variant_new_copy;
    GDExtensionInterfaceVariantDestroy variant_destroy;
    GDExtensionInterfaceVariantCall variant_call;
    GDExtensionInterfaceVariantConstruct variant_construct;
    GDExtensionInterfaceVariantGet variant_get;
    GDExtensionInterfaceVariantSet variant_set;
    GDExtensionInterfaceVariantGetType variant_get_type;
    GDExtensionInterfaceVariantCanConvertStrict variant_can_convert_strict;
    GDExtensionInterfaceGetVariantFromTypeConstructor get_variant_from_type_constructor;
    GDExtensionInterfaceGetVariantToTypeConstructor get_variant_to_type_constructor;
    GDExtensionInterfaceGetVariantGetInternalPtrFunc variant_get_ptr_internal_getter;
    GDExtensionInterfaceVariantGetPtrDestructor variant_get_ptr_destructor;
    GDExtensionInterfaceStringNewWithUtf8Chars string_new_with_utf8_chars;
    GDExtensionInterfaceStringToUtf8Chars string_to_utf8_chars;
    GDExtensionInterfaceStringNameNewWithLatin1Chars string_name_new_with_latin1_chars;
    GDExtensionInterfacePackedByteArrayOperatorIndexConst packed_byte_array_operator_index_const;
    GDExtensionInterfaceGlobalGetSingleton global_get_singleton;
    GDExtensionInterfaceObjectSetInstance object_set_instance;
    GDExtensionInterfaceObjectSetInstanceBinding object_set_instance_binding;
    GDExtensionInterfaceObjectGetInstanceBinding object_get_instance_binding;
    GDExtensionInterfaceObjectGetInstanceFromId object_get_instance_from_id;
    GDExtensionInterfacePrintErrorWithMessage print_error_with_message;
    GDExtensionInterfacePrintWarningWithMessage print_warning_with_message;
    GDExtensionInterfaceClassdbConstructObject classdb_construct_object;
    GDExtensionInterfaceClassdbConstructObject2 classdb_construct_object2;
    GDExtensionInterfaceClassdbRegisterExtensionClass4 classdb_register_extension_class4;
    GDExtensionInterfaceClassdbRegisterExtensionClassMethod classdb_register_extension_class_method;
    GDExtensionInterfaceClassdbRegisterExtensionClassProperty classdb_register_extension_class_property;
    GDExtensionInterfaceClassdbRegisterExtensionClassPropertyGroup classdb_register_extension_class_property_group;
    GDExtensionInterfaceClassdbRegisterExtensionClassSignal classdb_register_extension_class_signal;
    GDExtensionInterfaceClassdbUnregisterExtensionClass classdb_unregister_extension_class;
};

Interface godot;
GDExtensionClassLibraryPtr library;

// A String that is destroyed at the end of its scope.
class String {
public:
    explicit String(const std::string& text) { godot.string_new_with_utf8_chars(&opaque_, text.c_str()); }
    ~String() {
        static const GDExtensionPtrDestructor destroy = godot.variant_get_ptr_destructor(GDEXTENSION_VARIANT_TYPE_STRING);
        destroy(&opaque_);
    }
    String(const String&) = delete;
    String& operator=(const String&) = delete;
    void* raw() { return &opaque_; }

private:
    void* opaque_ = nullptr;
};

// A StringName. Names live as long as the program: there is one for each literal.
struct Name {
    void* opaque = nullptr;
    explicit Name(const char* text) { godot.string_name_new_with_latin1_chars(&opaque, text, false); }
    // Map nodes stay where they are, so that Godot may keep the address.
    static void* of(const std::string& text) {
        static auto* names = new std::unordered_map<std::string, Name>();
        return &names->try_emplace(text, text.c_str()).first->second.opaque;
    }
    // The same, found by the address of the literal instead of by its characters, for calls in every tick.
    static void* of_literal(const char* literal) {
        static auto* names = new std::unordered_map<const char*, void*>();
        void*& name = (*names)[literal];
        if (name == nullptr) {
            name = of(literal);
        }
        return name;
    }
};

// A description of an argument, a result or a property, with the texts that it points at.
class Info {
public:
    explicit Info(const Property& property) : hint_text_(property.hint_text) {
        constexpr uint32_t usage_default = 6, usage_nil_is_variant = 1 << 17;
        const bool is_any = property.type == GDEXTENSION_VARIANT_TYPE_NIL;
        raw.type = property.type;
        raw.name = Name::of(property.name);
        raw.class_name = Name::of(property.class_name);
        raw.hint = property.hint;
        raw.hint_string = hint_text_.raw();
        raw.usage = usage_default | (is_any ? usage_nil_is_variant : 0);
    }
    GDExtensionPropertyInfo raw;

private:
    String hint_text_;
};

// Infos in a row, as registration takes them.
struct InfoList {
    std::vector<std::unique_ptr<Info>> owners;
    std::vector<GDExtensionPropertyInfo> raw;
    void add(const Property& property) {
        owners.push_back(std::make_unique<Info>(property));
        raw.push_back(owners.back()->raw);
    }
};

template <typename T>
T value_or_zero(const Variant& variant, Type type) {
    T value{};
    if (variant.type() == type) {
        variant.to_pointer(type, &value);
    }
    return value;
}

}  // namespace

void connect(GDExtensionInterfaceGetProcAddress find, GDExtensionClassLibraryPtr own_library) {
    library = own_library;
#define FIND(name) godot.name = reinterpret_cast<decltype(godot.name)>(reinterpret_cast<void*>(find(#name)))
    FIND(variant_new_nil);
    FIND(variant_new_copy);
    FIND(variant_destroy);
    FIND(variant_call);
    FIND(variant_construct);
    FIND(variant_get);
    FIND(variant_set);
    FIND(variant_get_type);
    FIND(variant_can_convert_strict);
    FIND(get_variant_from_type_constructor);
    FIND(get_variant_to_type_constructor);
    FIND(variant_get_ptr_internal_getter);
    FIND(variant_get_ptr_destructor);
    FIND(string_new_with_utf8_chars);
    FIND(string_to_utf8_chars);
    FIND(string_name_new_with_latin1_chars);
    FIND(packed_byte_array_operator_index_const);
    FIND(global_get_singleton);
    FIND(object_set_instance);
    FIND(object_set_instance_binding);
    FIND(object_get_instance_binding);
    FIND(object_get_instance_from_id);
    FIND(print_error_with_message);
    FIND(print_warning_with_message);
    FIND(classdb_construct_object);
    FIND(classdb_construct_object2);
    FIND(classdb_register_extension_class4);
    FIND(classdb_register_extension_class_method);
    FIND(classdb_register_extension_class_property);
    FIND(classdb_register_extension_class_property_group);
    FIND(classdb_register_extension_class_signal);
    FIND(classdb_unregister_extension_class);
#undef FIND
}

void unregister_class(const char* name) { godot.classdb_unregister_extension_class(library, Name::of(name)); }

void push_error(const std::string& message) {
    godot.print_error_with_message("surefoot", message.c_str(), "surefoot", "surefoot", 0, true);
}

void push_warning(const std::string& message) {
    godot.print_warning_with_message("surefoot", message.c_str(), "surefoot", "surefoot", 0, true);
}

// ---------------------------------------------------------------------------------------------------------------- values

Variant::Variant() { godot.variant_new_nil(bytes_); }

Variant::Variant(bool value) {
    GDExtensionBool raw = value;
    godot.get_variant_from_type_constructor(GDEXTENSION_VARIANT_TYPE_BOOL)(bytes_, &raw);
}

Variant::Variant(int64_t value) { godot.get_variant_from_type_constructor(GDEXTENSION_VARIANT_TYPE_INT)(bytes_, &value); }

Variant::Variant(double value) { godot.get_variant_from_type_constructor(GDEXTENSION_VARIANT_TYPE_FLOAT)(bytes_, &value); }

Variant::Variant(const std::string& value) {
    String text(value);
    godot.get_variant_from_type_constructor(GDEXTENSION_VARIANT_TYPE_STRING)(bytes_, text.raw());
}

Variant::Variant(sf_vec3 value) { godot.get_variant_from_type_constructor(GDEXTENSION_VARIANT_TYPE_VECTOR3)(bytes_, &value); }

Variant::Variant(const Variant& other) { godot.variant_new_copy(bytes_, other.bytes_); }

Variant::Variant(Variant&& other) noexcept {
    // A Variant does not know its own address, so that its bytes can be moved.
    std::memcpy(bytes_, other.bytes_, sizeof bytes_);
    godot.variant_new_nil(other.bytes_);
}

Variant& Variant::operator=(Variant other) noexcept {
    unsigned char swapped[sizeof bytes_];
    std::memcpy(swapped, bytes_, sizeof bytes_);
    std::memcpy(bytes_, other.bytes_, sizeof bytes_);
    std::memcpy(other.bytes_, swapped, sizeof bytes_);
    return *this;
}

Variant::~Variant() { godot.variant_destroy(bytes_); }

Variant Variant::empty(Type type) {
    Variant value;
    GDExtensionCallError error;
    godot.variant_construct(type, value.bytes_, nullptr, 0, &error);
    return value;
}

Variant Variant::from_pointer(Type type, const void* value) {
    Variant variant;
    if (type == GDEXTENSION_VARIANT_TYPE_NIL) {
        godot.variant_new_copy(variant.bytes_, value);
    } else {
        godot.get_variant_from_type_constructor(type)(variant.bytes_, const_cast<void*>(value));
    }
    return variant;
}

Variant Variant::object(GDExtensionObjectPtr object) { return from_pointer(GDEXTENSION_VARIANT_TYPE_OBJECT, &object); }

Variant Variant::object_with(int64_t id) {
    GDExtensionObjectPtr found = godot.object_get_instance_from_id(static_cast<GDObjectInstanceID>(id));
    return found == nullptr ? Variant() : object(found);
}

Variant Variant::singleton(const char* name) { return object(godot.global_get_singleton(Name::of(name))); }

Type Variant::type() const { return godot.variant_get_type(bytes_); }

bool Variant::boolean() const { return value_or_zero<GDExtensionBool>(*this, GDEXTENSION_VARIANT_TYPE_BOOL); }

int64_t Variant::integer() const { return value_or_zero<int64_t>(*this, GDEXTENSION_VARIANT_TYPE_INT); }

double Variant::number() const { return value_or_zero<double>(*this, GDEXTENSION_VARIANT_TYPE_FLOAT); }

sf_vec3 Variant::vector3() const { return value_or_zero<sf_vec3>(*this, GDEXTENSION_VARIANT_TYPE_VECTOR3); }

GDExtensionObjectPtr Variant::object() const { return value_or_zero<GDExtensionObjectPtr>(*this, GDEXTENSION_VARIANT_TYPE_OBJECT); }

std::string Variant::text() const {
    static const auto internal = godot.variant_get_ptr_internal_getter(GDEXTENSION_VARIANT_TYPE_STRING);
    if (type() != GDEXTENSION_VARIANT_TYPE_STRING) {
        return {};
    }
    const void* string = internal(const_cast<unsigned char*>(bytes_));
    std::string text(static_cast<size_t>(godot.string_to_utf8_chars(string, nullptr, 0)), '\0');
    godot.string_to_utf8_chars(string, text.data(), static_cast<GDExtensionInt>(text.size()));
    return text;
}

std::vector<uint8_t> Variant::bytes() const {
    static const auto internal = godot.variant_get_ptr_internal_getter(GDEXTENSION_VARIANT_TYPE_PACKED_BYTE_ARRAY);
    const int64_t size = type() == GDEXTENSION_VARIANT_TYPE_PACKED_BYTE_ARRAY ? call("size").integer() : 0;
    if (size == 0) {
        return {};
    }
    const uint8_t* first = godot.packed_byte_array_operator_index_const(internal(const_cast<unsigned char*>(bytes_)), 0);
    return {first, first + size};
}

void Variant::to_pointer(Type type, void* value) const {
    if (type == GDEXTENSION_VARIANT_TYPE_NIL) {
        *static_cast<Variant*>(value) = *this;
    } else {
        godot.get_variant_to_type_constructor(type)(value, const_cast<unsigned char*>(bytes_));
    }
}

Variant Variant::at(const Variant& key) const {
    Variant value;
    GDExtensionBool is_valid = false;
    godot.variant_get(bytes_, key.bytes_, value.bytes_, &is_valid);
    return is_valid ? value : Variant();
}

void Variant::set(const Variant& key, const Variant& value) {
    GDExtensionBool is_valid = false;
    godot.variant_set(bytes_, key.bytes_, value.bytes_, &is_valid);
}

Variant Variant::call_with(const char* method, const Variant* arguments, size_t count) const {
    constexpr size_t most = 8;
    GDExtensionConstVariantPtr pointers[most] = {};
    for (size_t idx = 0; idx < count && idx < most; idx++) {
        pointers[idx] = arguments[idx].bytes_;
    }
    Variant result;
    GDExtensionCallError error{};
    godot.variant_call(const_cast<unsigned char*>(bytes_), Name::of_literal(method), pointers, static_cast<GDExtensionInt>(count), result.bytes_, &error);
    if (error.error != GDEXTENSION_CALL_OK) {
        push_error(std::string("Godot does not take the call of ") + method + ": this version of Godot differs from those that the extension knows");
        return Variant();
    }
    return result;
}

// ---------------------------------------------------------------------------------------------------------------- instances

Instance* Instance::of(const Variant& object) {
    const GDExtensionObjectPtr pointer = object.object();
    return pointer == nullptr ? nullptr : static_cast<Instance*>(godot.object_get_instance_binding(pointer, library, nullptr));
}

// ---------------------------------------------------------------------------------------------------------------- registration

namespace {

struct Class {
    std::string name;
    std::string parent;
    ClassBuilder::Create create;
};

const GDExtensionInstanceBindingCallbacks no_callbacks{
    nullptr, nullptr, [](void*, void*, GDExtensionBool) -> GDExtensionBool { return true; }};

GDExtensionObjectPtr create_instance(void* userdata, GDExtensionBool notifies) {
    const Class& described = *static_cast<Class*>(userdata);
    const GDExtensionObjectPtr object = notifies ? godot.classdb_construct_object(Name::of(described.parent))
                                                 : godot.classdb_construct_object2(Name::of(described.parent));
    Instance* instance = described.create().release();
    instance->bind(object);
    godot.object_set_instance(object, Name::of(described.name), instance);
    godot.object_set_instance_binding(object, library, instance, &no_callbacks);
    return object;
}

void free_instance(void*, GDExtensionClassInstancePtr instance) { delete static_cast<Instance*>(instance); }

void notify(GDExtensionClassInstancePtr instance, int32_t what, GDExtensionBool) { static_cast<Instance*>(instance)->notified(what); }

// The arguments of a call with their declared types. False, and an error, if one has another type or is missing.
bool take_arguments(const Method& method, const GDExtensionConstVariantPtr* given, GDExtensionInt given_count, std::vector<Variant>& arguments,
                    GDExtensionCallError& error) {
    const size_t count = method.argument_types.size(), optional = method.defaults.size(), given_size = static_cast<size_t>(given_count);
    if (given_size > count || given_size + optional < count) {
        const bool are_few = given_size < count;
        error.error = are_few ? GDEXTENSION_CALL_ERROR_TOO_FEW_ARGUMENTS : GDEXTENSION_CALL_ERROR_TOO_MANY_ARGUMENTS;
        error.expected = static_cast<int32_t>(are_few ? count - optional : count);
        return false;
    }
    for (size_t idx = 0; idx < count; idx++) {
        if (idx >= given_size) {
            arguments.push_back(method.defaults[optional - (count - idx)]);
            continue;
        }
        const Type wanted = method.argument_types[idx], found = godot.variant_get_type(given[idx]);
        if (wanted == found || wanted == GDEXTENSION_VARIANT_TYPE_NIL) {
            arguments.push_back(Variant::from_pointer(GDEXTENSION_VARIANT_TYPE_NIL, given[idx]));
        } else if (godot.variant_can_convert_strict(found, wanted)) {
            arguments.emplace_back();
            godot.variant_construct(wanted, arguments.back().raw(), &given[idx], 1, &error);
        } else {
            error = {GDEXTENSION_CALL_ERROR_INVALID_ARGUMENT, static_cast<int32_t>(idx), wanted};
            return false;
        }
    }
    return true;
}

void call(void* userdata, GDExtensionClassInstancePtr instance, const GDExtensionConstVariantPtr* given, GDExtensionInt given_count,
          GDExtensionVariantPtr result, GDExtensionCallError* error) {
    const Method& method = *static_cast<Method*>(userdata);
    std::vector<Variant> arguments;
    *error = {GDEXTENSION_CALL_OK, 0, 0};
    if (take_arguments(method, given, given_count, arguments, *error)) {
        *static_cast<Variant*>(result) = method.call(*static_cast<Instance*>(instance), arguments.data());
    }
}

// The same for scripts whose types are known when they are compiled: pointers instead of variants.
void call_with_pointers(void* userdata, GDExtensionClassInstancePtr instance, const GDExtensionConstTypePtr* given, GDExtensionTypePtr result) {
    const Method& method = *static_cast<Method*>(userdata);
    std::vector<Variant> arguments;
    for (size_t idx = 0; idx < method.argument_types.size(); idx++) {
        arguments.push_back(Variant::from_pointer(method.argument_types[idx], given[idx]));
    }
    const Variant value = method.call(*static_cast<Instance*>(instance), arguments.data());
    if (method.has_result) {
        value.to_pointer(method.result, result);
    }
}

}  // namespace

ClassBuilder::ClassBuilder(const char* name, const char* parent, bool is_runtime, Create create) : name_(name) {
    GDExtensionClassCreationInfo4 info{};
    info.is_exposed = true;
    info.is_runtime = is_runtime;
    info.notification_func = notify;
    info.create_instance_func = create_instance;
    info.free_instance_func = free_instance;
    // Godot keeps the pointer as long as it runs.
    info.class_userdata = new Class{name, parent, create};
    godot.classdb_register_extension_class4(library, Name::of(name), Name::of(parent), &info);
}

void ClassBuilder::add(Method described) {
    // Godot keeps the pointer as long as it runs.
    Method& method = *new Method(std::move(described));
    InfoList arguments;
    for (size_t idx = 0; idx < method.argument_types.size(); idx++) {
        arguments.add({method.argument_names.at(idx), method.argument_types[idx], 0, "", ""});
    }
    std::vector<GDExtensionClassMethodArgumentMetadata> metadata(arguments.raw.size(), GDEXTENSION_METHOD_ARGUMENT_METADATA_NONE);
    std::vector<GDExtensionVariantPtr> defaults;
    for (Variant& value : method.defaults) {
        defaults.push_back(value.raw());
    }
    Info result({"", method.result, 0, "", ""});
    GDExtensionClassMethodInfo info{};
    info.name = Name::of(method.name);
    info.method_userdata = &method;
    info.call_func = call;
    info.ptrcall_func = call_with_pointers;
    info.method_flags = GDEXTENSION_METHOD_FLAGS_DEFAULT;
    info.has_return_value = method.has_result;
    info.return_value_info = &result.raw;
    info.argument_count = static_cast<uint32_t>(arguments.raw.size());
    info.arguments_info = arguments.raw.data();
    info.arguments_metadata = metadata.data();
    info.default_argument_count = static_cast<uint32_t>(defaults.size());
    info.default_arguments = defaults.data();
    godot.classdb_register_extension_class_method(library, Name::of(name_), &info);
}

void ClassBuilder::add(const Property& property) {
    const Info info(property);
    godot.classdb_register_extension_class_property(library, Name::of(name_), &info.raw, Name::of("set_" + property.name), Name::of("get_" + property.name));
}

ClassBuilder& ClassBuilder::group(const char* name) {
    String text(name), prefix("");
    godot.classdb_register_extension_class_property_group(library, Name::of(name_), text.raw(), prefix.raw());
    return *this;
}

ClassBuilder& ClassBuilder::signal(const char* name, const std::vector<std::pair<std::string, Type>>& arguments) {
    InfoList infos;
    for (const auto& [argument, type] : arguments) {
        infos.add({argument, type, 0, "", ""});
    }
    godot.classdb_register_extension_class_signal(library, Name::of(name_), Name::of(name), infos.raw.data(), static_cast<GDExtensionInt>(infos.raw.size()));
    return *this;
}

}  // namespace engine
