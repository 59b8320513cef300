"""The grammar of RAPID, production by production, as in the kernel manual.

A controller accepts or refuses each text.
"""

import pytest

from camgen.lang.log import Log
from camgen.lang.programs import Finding
from camgen.lang.rapid import tree
from camgen.lang.rapid.expressions import Calls
from camgen.lang.rapid.grammar import parse
from camgen.lang.rapid.tree import (
    Assign,
    CallByName,
    Calling,
    Component,
    Connect,
    Element,
    Empty,
    Expr,
    For,
    Goto,
    Hole,
    If,
    Inline,
    Label,
    Maybe,
    Module,
    Negation,
    Operation,
    Ref,
    Routine,
    While,
    Word,
    list_statements,
)


def make_module(text: str) -> str:
    return f"MODULE m\n{text}\nENDMODULE\n"


def make_routine(body: str, head: str = "PROC main()", end: str = "ENDPROC") -> str:
    return make_module(f"{head}\n{body}\n{end}")


def parse_modules(text: str) -> tuple[list[Module], tuple[Finding, ...]]:
    log = Log()
    return parse(text, 1, log), log.list_findings()


def list_faults(text: str) -> list[str]:
    return [finding.what for finding in parse_modules(text)[1] if finding.level == "refused"]


def parse_statements(body: str) -> tuple[object, ...]:
    modules, findings = parse_modules(make_routine(body))
    assert findings == ()
    return tuple(list_statements(modules[0].routines[0].body))


def parse_expression(text: str) -> Expr:
    parser = Calls(text, 1)
    expression = parser.expression()
    assert parser.token[0] == "end"
    return expression


# Modules and declarations -------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "",
        "MODULE m\nENDMODULE",
        "module m\nendmodule",
        "MODULE m(SYSMODULE)\nENDMODULE",
        "MODULE m(SYSMODULE,NOSTEPIN,READONLY)\nENDMODULE",
        "%%%\n  VERSION:1\n  LANGUAGE:ENGLISH\n%%%\nMODULE m\nENDMODULE\n",
        "MODULE a\nENDMODULE\nMODULE b\nENDMODULE\n",
        "! a comment\nMODULE m\n! a comment\nENDMODULE\n! a comment\n",
        make_module("RECORD point\nnum x;\nnum y;\nENDRECORD"),
        make_module(
            "LOCAL RECORD point\nnum x;\nENDRECORD\nALIAS num level;\nLOCAL ALIAS num depth;"
        ),
        make_module("VAR num a;\nVAR num b:=1;\nVAR num c{3};\nVAR num d{2,3}:=[[1,2,3],[4,5,6]];"),
        make_module(
            "CONST num a:=2*3;\nCONST num b{a}:=[1,2,3,4,5,6];\n"
            'LOCAL CONST string s:="a""b\\\\c\\07";'
        ),
        make_module(
            "PERS num a:=-1;\nTASK PERS num b:=1;\nLOCAL PERS bool c:=TRUE;\nPERS num d;\n"
            "TASK VAR num e;"
        ),
        make_module("PERS num a{2}:=[1,-2];\nPERS pos p:=[1,2,3];"),
        make_module(
            "VAR num a:=.5;\nVAR num b:=5.;\nVAR num c:=1E3;\nVAR num d:=9E+09;\nVAR num e:=0x1F;"
        ),
        make_routine(
            "", "PROC p(num a, VAR num b, PERS tooldata c, INOUT num d, num e{*}, num f{*,*})"
        ),
        make_routine("", "PROC p(\\num a \\switch b | switch c, num d \\VAR num e)"),
        make_routine("", "PROC p(switch on)"),
        make_routine("RETURN 1;", "FUNC num f(num a)", "ENDFUNC"),
        make_routine("RETURN;", "TRAP t", "ENDTRAP"),
        make_routine("", "LOCAL PROC p()"),
        make_routine("VAR num a;\nCONST num b:=1;\na:=b;"),
        make_routine("a;\nBACKWARD\nb;\nERROR\nTRYNEXT;\nUNDO\nc;"),
        make_routine("a;\nERROR (ERR_ONE, 7)\nIF ERRNO=ERR_ONE RETRY;\nRAISE;"),
        make_module("<DDN>\n<RDN>"),
    ],
)
def test_a_declaration_that_controllers_accept_has_no_fault(text: str) -> None:
    assert list_faults(text) == []


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("x", "'x' stands outside a module"),
        ("MODULE m\n", "ENDMODULE of m is missing"),
        ("MODULE 1m\nENDMODULE", "a module name expected, found '1'"),
        ("MODULE m(FAST)\nENDMODULE", "FAST is not an attribute of a module"),
        ("MODULE m(NOVIEW,NOVIEW)\nENDMODULE", "the attribute NOVIEW is given twice"),
        ("MODULE m(NOVIEW\nENDMODULE", ") of the module's attributes is missing"),
        (make_module("RECORD r\nnum;\nENDRECORD"), "the name of a num expected, found ';'"),
        (make_module("ALIAS num;"), "the name of an ALIAS expected, found ';'"),
        (make_module("CONST num a;"), "a has no value"),
        (make_module("LOCAL PERS num a;"), "a has no value"),
        (make_module("PERS num a:=b;"), "PERS a must have a literal value"),
        (make_module("VAR num a{};"), "a value expected, found '}'"),
        (make_module("VAR num a"), "; expected, found 'ENDMODULE'"),
        (make_module("VAR a;"), "the name of a a expected, found ';'"),
        (make_module("num a;"), "a declaration expected, found 'num'"),
        (make_module("VAR num while;"), "the name of a num expected, found 'while'"),
        (make_module('VAR string s:="abc;'), "a value expected, found '\"'"),
        (
            make_module(f'VAR string s:="{"a" * 81}";'),
            "a string of 81 characters; a controller takes 80",
        ),
        (make_module("VAR num a:=1E99;"), "1E99 is larger than a num can be"),
        (make_routine("", "PROC p"), "( expected, found 'ENDPROC'"),
        (make_routine("", "PROC p(num)"), "the name of a parameter expected, found ')'"),
        (make_routine("", "PROC p(num a num b)"), ", or ) expected, found 'num'"),
        (make_routine("", "FUNC f()", "ENDFUNC"), "the name of a FUNC expected, found '('"),
        (make_routine("", "PROC main()", ""), "ENDPROC of main is missing"),
        (make_routine("PERS num a:=1;"), "PERS inside a routine"),
        (make_routine("a;\nVAR num b;"), "VAR after the first statement of a routine"),
    ],
)
def test_a_declaration_that_controllers_refuse_has_a_fault(text: str, what: str) -> None:
    assert what in list_faults(text)


def test_a_parameter_has_its_mode_and_its_alternatives() -> None:
    text = make_routine(
        "", "FUNC num f(\\switch on | switch off, PERS num a{*} \\INOUT num b)", "ENDFUNC"
    )
    parsed = parse_modules(text)[0][0].routines[0]
    assert isinstance(parsed, Routine)
    assert (parsed.kind, parsed.gives, parsed.last) == ("func", "num", 4)
    notes = [
        (
            parameter.mode,
            parameter.type,
            parameter.name,
            parameter.dims,
            parameter.optional,
            parameter.group,
        )
        for parameter in parsed.parameters
    ]
    assert notes == [
        ("", "switch", "on", 0, True, 1),
        ("", "switch", "off", 0, True, 1),
        ("pers", "num", "a", 1, False, 2),
        ("inout", "num", "b", 0, True, 3),
    ]


def test_data_after_a_routine_are_unusual_and_read() -> None:
    modules, findings = parse_modules(make_module("PROC p()\nENDPROC\nVAR num a;"))
    assert [(finding.line, finding.level) for finding in findings] == [(4, "unusual")]
    assert [data.name for data in modules[0].data] == ["a"]


# Statements ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "kinds"),
    [
        ("a:=1;", [Assign]),
        ("a{1}:=1;\na.b:=1;\na{1,2}.b.c{3}:=1;", [Assign, Assign, Assign]),
        ("p;\np 1;\np 1,2\\x:=3\\y;\np\\x,1;", [Calling] * 4),
        ("p a:=1,b:=2;", [Calling]),
        ("p\\x?y;", [Calling]),
        ("p (1+2);\np (1),2;", [Calling, Calling]),
        ('%"p"%;\n%"p"+"1"% 1,2\\x;', [CallByName, CallByName]),
        ("GOTO a;\na:\nb:c;", [Goto, Label, Label, Calling]),
        ("RETURN;\nRETURN 1;\nRAISE;\nRAISE 7;\nEXIT;", [Word] * 5),
        ("CONNECT i WITH t;\nCONNECT i{1} WITH t;", [Connect, Connect]),
        ("IF a p;", [If]),
        ("IF a b:=1;\nIF a RETURN;\nIF a GOTO x;\nIF a %s%;", [If] * 4),
        ("IF a THEN\nENDIF", [If]),
        ("IF a THEN\np;\nELSEIF b THEN\np;\nELSEIF c THEN\nELSE\np;\nENDIF", [If]),
        ("FOR i FROM 1 TO 3 DO\np;\nENDFOR\nFOR i FROM 3 TO 1 STEP -1 DO\nENDFOR", [For, For]),
        ("WHILE TRUE DO\np;\nENDWHILE", [While]),
        (
            "TEST a\nCASE 1:\np;\nCASE 2,3:\nDEFAULT:\nENDTEST\nTEST a\nENDTEST",
            [tree.Test, tree.Test],
        ),
        ("<SMT>\n<VAR>:=1;", [Empty, Empty]),
        ("MoveL *,v100,z10,tool0;", [Calling]),
        (
            "MoveL [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v5,z1,t\\WObj:=w;",
            [Inline],
        ),
        ("MoveL [[1, 2, 3],[1,0,0,0],[0,0,0,0],\n[9E9,9E9,9E9,9E9,9E9,9E9]],v5,z1,t;", [Calling]),
        ("! a comment\np; ! a comment", [Calling]),
    ],
)
def test_a_statement_that_controllers_accept_is_parsed(body: str, kinds: list[type]) -> None:
    assert [type(statement) for statement in parse_statements(body)] == kinds


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ("p 1", "; expected, found 'ENDPROC'"),
        ("p 1,;", "a value expected, found ';'"),
        ("p();", "a value expected, found ')'"),
        ("p(1,2);", ") expected, found ','"),
        ("a=1;", "a value expected, found '='"),
        ("a:=;", "a value expected, found ';'"),
        ("a{1:=2;", "} expected, found ':='"),
        ("a.:=2;", "a component expected, found ':='"),
        ("%a;", "% expected, found ';'"),
        ("GOTO 1;", "a label expected, found '1'"),
        ("CONNECT i t;", "WITH expected, found 't'"),
        ("IF THEN\nENDIF", "a value expected, found 'THEN'"),
        ("IF a THEN\np;", "ENDIF of the statement in line 3 is missing"),
        ("IF a THEN\nELSE\nELSE\nENDIF", "ELSE without its IF"),
        ("ENDIF", "ENDIF without its IF"),
        ("FOR i FROM 1 DO\nENDFOR", "TO expected, found 'DO'"),
        ("FOR i FROM 1 TO 2 DO\np;", "ENDFOR of the statement in line 3 is missing"),
        ("FOR 1 FROM 1 TO 2 DO\nENDFOR", "the name of a loop variable expected, found '1'"),
        ("WHILE a\np;\nENDWHILE", "DO expected, found 'p'"),
        ("WHILE a DO\np;", "ENDWHILE of the statement in line 3 is missing"),
        ("TEST a\nCASE 1\nENDTEST", ": expected, found 'ENDTEST'"),
        ("TEST a\nCASE 1:\np;", "ENDTEST of the statement in line 3 is missing"),
        ("CASE 1:\np;", "CASE without its TEST"),
        ("MODULE x;", "ENDPROC of main is missing"),
        ("5;", "a statement expected, found '5'"),
        ("TO;", "a statement expected, found 'TO'"),
    ],
)
def test_a_statement_that_controllers_refuse_has_a_fault(body: str, what: str) -> None:
    assert what in list_faults(make_routine(body))


def test_a_fault_in_a_condition_does_not_hide_the_next_statements() -> None:
    modules, findings = parse_modules(make_routine("WHILE a = = b DO\np;\nENDWHILE\nq;"))
    assert [finding.line for finding in findings] == [3]
    assert [type(statement) for statement in modules[0].routines[0].body] == [While, Calling]


def test_nested_statements_have_a_limit_of_depth() -> None:
    assert "statements nested too deeply" in list_faults(
        make_routine("IF a THEN\n" * 200 + "ENDIF\n" * 200)
    )


# Expressions --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1", 1.0),
        ("-1", -1.0),
        ("0b101", 5.0),
        ("TRUE", True),
        ('"a""b"', 'a"b'),
        ("[1,[2,3]]", (1.0, (2.0, 3.0))),
        ("a", Ref("a")),
        ("a.B{1}", Element(Component(Ref("a"), "b"), (1.0,))),
        ("<EXP>", Hole("<EXP>")),
        ("1+2*3", Operation("+", 1.0, Operation("*", 2.0, 3.0))),
        ("1-2-3", Operation("-", Operation("-", 1.0, 2.0), 3.0)),
        ("7 DIV 2 MOD 3", Operation("mod", Operation("div", 7.0, 2.0), 3.0)),
        ("(1+2)*3", Operation("*", Operation("+", 1.0, 2.0), 3.0)),
        ("a<>1", Operation("<>", Ref("a"), 1.0)),
        ("a OR b AND c", Operation("or", Ref("a"), Operation("and", Ref("b"), Ref("c")))),
        ("a XOR b", Operation("xor", Ref("a"), Ref("b"))),
        (
            "a=1 AND b<2",
            Operation("and", Operation("=", Ref("a"), 1.0), Operation("<", Ref("b"), 2.0)),
        ),
        # In the kernel manual NOT precedes a whole logical term: it negates both operands here.
        ("NOT a AND b", Negation("not", Operation("and", Ref("a"), Ref("b")))),
        ("a AND NOT b", Operation("and", Ref("a"), Negation("not", Ref("b")))),
        ("-a*2", Operation("*", Negation("-", Ref("a")), 2.0)),
        ("1*-2", Operation("*", 1.0, -2.0)),
    ],
)
def test_an_expression_is_parsed_by_its_precedence(text: str, expected: Expr) -> None:
    assert parse_expression(text) == expected


def test_a_function_has_arguments_and_options() -> None:
    call = parse_expression("f(1\\x:=2\\y?z,\\w)")
    assert isinstance(call, Calling)
    assert (call.name, call.args) == ("f", (1.0,))
    assert call.options == (("x", 2.0), ("y", Maybe("z")), ("w", None))
    empty = parse_expression("f()")
    assert isinstance(empty, Calling)
    assert empty.args == ()
