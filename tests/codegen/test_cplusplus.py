"""What is read of a C++ class: its methods, wherever braces and preprocessors lead."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.codegen.cplusplus import Method, Unit, read


def unit(text: str) -> Unit:
    return read("src/specificworker.cpp", text, "SpecificWorker")


def defined(text: str) -> list[str]:
    return [each.text for each in unit(text).defined]


def declared(members: str) -> list[Method]:
    return list(unit(f"class SpecificWorker : public GenericWorker\n{{\n{members}\n}};").declared)


@pytest.mark.parametrize(
    ("text", "method"),
    [
        ("void SpecificWorker::compute() {}", "void compute()"),
        ("SpecificWorker::SpecificWorker(MapPrx& mprx) : GenericWorker(mprx) {}", "SpecificWorker(MapPrx& mprx)"),
        ("SpecificWorker::SpecificWorker() : a{1}, b(f({2})), c{} { x(); }", "SpecificWorker()"),
        ("SpecificWorker::~SpecificWorker() {}", "~SpecificWorker()"),
        ("SpecificWorker::~SpecificWorker() = default;", "~SpecificWorker()"),
        ("inline int SpecificWorker::size() const noexcept { return 1; }", "int size()"),
        ("auto SpecificWorker::f(int) -> std::vector<int> {}", "std::vector<int> f(int)"),
        ("template<typename T, int N = 3> T SpecificWorker::g(const T &t) {}", "T g(const T& t)"),
        ("SpecificWorker::Room SpecificWorker::room() {}", "SpecificWorker::Room room()"),
        (
            "std::map<string, int> SpecificWorker::m(const std::map<string, int> &m, unsigned int, int x[3]) {}",
            "std::map<string, int> m(const std::map<string, int>& m, unsigned int, int[3] x)",
        ),
        ("namespace a { namespace b { bool SpecificWorker::f(void) {} } }", "bool f()"),
        ("bool SpecificWorker::f(int a = g(1, 2), char c = ',') {}", "bool f(int a, char c)"),
        ("void SpecificWorker::f(std::function<void(int, int)> done) {}", "void f(std::function<void(int, int)> done)"),
    ],
)
def test_a_definition_is_read_as_it_is_written(text: str, method: str) -> None:
    assert defined(text) == [method]


def test_what_is_only_called_or_named_is_no_definition() -> None:
    text = """
    void SpecificWorker::initialize()
    {
        connect(&timer, SIGNAL(timeout()), this, SLOT(compute()));
        auto f = std::bind(&SpecificWorker::compute, this);
        SpecificWorker::compute();
        auto g = [this](int x) { if (x) { return SpecificWorker::other(x); } return 0; };
    }
    int main() { SpecificWorker::global(); }
    """
    assert defined(text) == ["void initialize()"]


def test_comments_strings_and_characters_hide_what_is_in_them() -> None:
    text = r"""
    // void SpecificWorker::no() {}
    /* void SpecificWorker::no() {} */
    void SpecificWorker::one() { puts("} void SpecificWorker::no() {"); char c = '}'; auto d = '"'; }
    void SpecificWorker::two() { auto raw = R"x(" } )" )x"; int n = 1'000'000; }
    void SpecificWorker::three() {}
    """
    assert defined(text) == ["void one()", "void two()", "void three()"]


def test_the_first_branch_of_the_preprocessor_counts() -> None:
    text = """
    #ifdef USE_QTGUI
    void SpecificWorker::draw(int a) {
    #else
    void SpecificWorker::draw() {
    #endif
    }
    #if 0
    void SpecificWorker::old() {
    #elif defined(NEW)
    void SpecificWorker::young() {}
    #endif
    """
    assert defined(text) == ["void draw(int a)", "void young()"]


def test_lines_are_those_of_the_names() -> None:
    text = '#include <a.h>\n/* two\nlines */\nint\nSpecificWorker::far()\n{\n}\n#include "b/c.h"\n'
    found = unit(text)
    assert [each.line for each in found.defined] == [5]
    assert [(each.name, each.line, each.quoted) for each in found.includes] == [("a.h", 1, False), ("b/c.h", 8, True)]


def test_references_to_what_may_change_give_something_back() -> None:
    [method] = unit("void SpecificWorker::f(int &a, const T &b, T&& c, std::vector<const T>& d, T *e) {}").defined
    assert [each.name for each in method.parameters if each.gives_back] == ["a", "d"]


def test_a_class_declares_methods_between_everything_else() -> None:
    members = """
    Q_OBJECT
    Q_PROPERTY(int a READ b)
    public:
        SpecificWorker(TuplePrx tprx, bool startup_check);
        ~SpecificWorker();
        [[nodiscard]] double gaussian(double x) const;
        virtual void pure() = 0;
    public slots:
        void compute();
        int startup_check();
    private:
        using Buffer = Doubled<int(int)>;
        struct Params { int a() { return 1; } bool b = f(3); } params;
        std::function<void(int)> callback;
        Buffer buffer{5 /* capacity */, 1.0};
        std::vector<int> v = make(3);
        int table[3];
        static const int N = 3;
        bool done(int a, std::string &why) { return a > N; }
        friend class Other;
        MACRO(x)
        QTimer timer;
    signals:
        void moved(int by);
    """
    names = [(each.name, each.section) for each in declared(members)]
    assert names == [
        ("SpecificWorker", ""),
        ("~SpecificWorker", ""),
        ("gaussian", ""),
        ("pure", ""),
        ("compute", "slots"),
        ("startup_check", "slots"),
        ("moved", "signals"),
    ]


def test_a_method_may_be_defined_in_its_class() -> None:
    found = unit("class SpecificWorker { public: int a() const { return b; } void c(); int b{1}; };")
    assert [each.text for each in found.defined] == ["int a()"]
    assert [each.text for each in found.declared] == ["void c()"]


def test_another_class_is_none_of_ours() -> None:
    found = unit("class Other { void f(); }; void Other::f() {} class SpecificWorker; void free(SpecificWorker *w) {}")
    assert not found.defined
    assert not found.declared


NAMES = ["SpecificWorker", "f", "class", "template", "signals", "const"]
MARKS = [
    "::",
    "~",
    "(",
    ")",
    "{",
    "}",
    ";",
    ":",
    "<",
    ">",
    ",",
    "=",
    "->",
    "[",
    "]",
    '"',
    "'",
    "/*",
    "*/",
    "//",
    'R"(',
    "&",
]
LINES = ("#if 0\n", "#else\n", "#endif\n", "\n", " ")
PIECES = st.sampled_from([*NAMES, *MARKS, *LINES])


@given(st.lists(PIECES, max_size=40).map("".join))
def test_no_text_breaks_the_reader(text: str) -> None:
    found = unit(text)
    assert all(each.line <= text.count("\n") + 1 for each in (*found.defined, *found.declared))
